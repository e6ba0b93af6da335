"""What a file of results says of one thing, field by field."""

from pydantic import BaseModel, ConfigDict


class PlainTable(BaseModel):
    """A table of ``summary.json``; its fields say in their descriptions what they are."""

    model_config = ConfigDict(frozen=True, extra="forbid")

"""Base of the tables in result files."""

from pydantic import BaseModel, ConfigDict


class PlainTable(BaseModel):
    """Table of ``summary.json``; its fields have descriptions."""

    model_config = ConfigDict(frozen=True, extra="forbid")

"""Calling the command line in this process."""

from click.testing import CliRunner, Result

from kaneflex.cli import main


def cli(*arguments: object) -> Result:
    """`cli("run", "engine")`: output and exit code; any exception but an exit is passed on."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    if not isinstance(result.exception, SystemExit | None):
        raise result.exception
    return result


def refused(result: Result, *words: str) -> None:
    """Exit code 2, and every word in the message on stderr, which is no traceback.

    Stages that lasted may stand before it: "compiling, first time only ...".
    """
    assert result.exit_code == 2
    stages, error, _ = result.stderr.partition("Error: ")
    assert error and all(line.endswith(" ...") for line in stages.splitlines())
    assert "Traceback" not in result.stderr
    for word in words:
        assert word in result.stderr

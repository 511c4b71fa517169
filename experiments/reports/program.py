"""The program's name and version, in words."""

from importlib.metadata import PackageNotFoundError, version

PROGRAM = "balancing-table-rig"  # stands in every page (templates/base.html)


def program_words(called: str = PROGRAM) -> str:
    """What it is `called`, and its version; a copy that nobody installed has none."""
    try:
        return f"{called} {version(PROGRAM)}"
    except PackageNotFoundError:
        return f"{called}, not installed and without a version"

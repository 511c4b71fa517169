"""A line on standard output that may hold text of files, recordings and their names."""

import typer


def say(text: object) -> None:
    """Print lines; control characters in them, which could steer the terminal, as "?"."""
    typer.echo("".join(c if c.isprintable() or c == "\n" else "?" for c in str(text)))

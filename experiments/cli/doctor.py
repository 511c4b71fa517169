"""`rig doctor`: is the rig file's table there, may it be used, and if not, what is to be done."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say


def doctor(
    rig: Annotated[
        Path | None, typer.Option("--rig", help="rig.toml; none: what is plugged in here.")
    ] = None,
) -> None:
    """Look for boards, cameras, permissions and limits. Says what is missing and the cure.

    Exit 0 when the rig file's table can be used, else 1. Nothing is moved.
    """
    from experiments.doctor.doctor import examine, usable
    from experiments.doctor.facts import gather
    from experiments.runs.assemble import load_rig

    known = load_rig(rig)
    findings = examine(gather(known, rig), known)
    for one in findings:
        say(f"{one.state:4s}  {one.what}: {one.text}")
        if one.cure:
            say(f"      -> {one.cure}")
    if not usable(findings):
        say("this table cannot be used yet: see the lines that begin with bad")
        raise typer.Exit(1)
    say(f"nothing that {rig or 'the virtual table'} needs is missing")

"""`rig serve`: let another machine drive the table that is plugged into this one."""

from pathlib import Path
from typing import Annotated

import typer

from experiments.cli.say import say, saying_aside

WARM_TICKS = 20  # whatever is compiled is there before a user is


def serve(
    rig: Annotated[Path | None, typer.Option("--rig", help="rig.toml of the table here.")] = None,
    host: Annotated[
        str, typer.Option(help="Address to listen at; 0.0.0.0 for the whole network.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65535, help="0: any free one.")] = 7643,
    token_file: Annotated[
        Path, typer.Option(help="The secret; made where there is none. Copy it to the user.")
    ] = Path("rig.token"),
) -> None:
    """Drive this machine's table for one user on the network. Until Ctrl-C.

    Who does not know the token is not listened to; who falls silent for 0.1 s loses the table.
    """
    from experiments.runs.assemble import load_rig
    from rig.hardware.choose import check_drive, open_table
    from rig.hardware.network.serve import Server
    from rig.hardware.network.token_file import is_from_here, make_token, read_token
    from rig.loop.realtime import go_realtime
    from rig.parameters import ANGLE_KINDS

    known = load_rig(rig)
    if known.table.kind == "remote":
        raise ValueError('table.kind = "remote" cannot be served: name the table that is here')
    if known.table.kind in ("serial", "usb"):
        raise ValueError(
            f'table.kind = "{known.table.kind}" is not served: a board keeps its own zero; plug it '
            "into the machine that runs the loop"
        )
    check_drive(known)
    if known.table.kind in ANGLE_KINDS:
        raise ValueError(f'table.kind = "{known.table.kind}" is not served: only volts are')
    if not token_file.exists():
        make_token(token_file)
        say(f"made {token_file}: copy it to the machine that shall drive the table")
    token = read_token(token_file)
    if not is_from_here(token_file):
        say(
            f"{token_file} was not made here: whoever made it can drive this table; remove it, and "
            "a new one is made"
        )
    table = open_table(known, homed=False)
    with table, saying_aside() as aside:
        server = Server(table, token, servo=known.servo, host=host, port=port, say=aside)
        with server:
            go_realtime()  # where it is allowed
            for _ in range(WARM_TICKS):
                server.tick()
            aside(f"serving the {known.table.kind} table at {host}:{server.port}")
            server.run()

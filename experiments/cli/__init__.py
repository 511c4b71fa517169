"""The command line `rig`. Imports nothing until `main` is asked for."""


def main() -> None:
    """Run `rig` with the arguments of this process, which ends with the command's exit code."""
    from experiments.cli.application import main as run

    run()

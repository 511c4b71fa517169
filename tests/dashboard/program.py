"""`rig` with its dashboard, as a program of its own for tests."""

from experiments import cli
from experiments.dashboard_command import dashboard

if not any(one.callback is dashboard for one in cli.app.registered_commands):
    cli.app.command()(dashboard)

if __name__ == "__main__":
    cli.main()

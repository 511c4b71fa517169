"""`python -m experiments.cli`: the command `rig` where no script of that name is installed."""

from experiments.cli import main

main()

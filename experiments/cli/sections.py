"""The commands of `rig --help`, by what a person wants to do."""

from typing import Any

from typer.core import TyperGroup

SECTIONS = {
    "Run a study": ("reproduce", "run", "report", "dashboard", "compare", "watch"),
    "Find what the model lacks": ("gap", "effects", "benchmark"),
    "Set up a real table": ("doctor", "home", "calibrate", "track", "serve"),
    "Recordings": ("import", "export", "export-model", "recover", "reject"),
    "Class": ("sheet", "check"),
}


class Sections(TyperGroup):
    """A group of commands whose help lists them in SECTIONS."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write the sections; all lines have room for the longest name."""
        longest = max(map(len, self.commands))
        for title, names in SECTIONS.items():
            lines = [
                (
                    name.ljust(longest),
                    self.commands[name].get_short_help_str(formatter.width - longest - 6),
                )
                for name in names
            ]
            with formatter.section(title):
                formatter.write_dl(lines)

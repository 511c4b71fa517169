"""The commands of `rig --help`, and the options of one, by what a person wants to do."""

from typing import Any

from typer.core import TyperCommand, TyperGroup

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


class OptionSections(TyperCommand):
    """A command whose help lists arguments and options by their `rich_help_panel`, in the order of
    their first ones."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Write the sections; an option without one stands in the last, Other."""
        sections: dict[str, list[tuple[str, str]]] = {}
        for one in self.get_params(ctx):
            if (record := one.get_help_record(ctx)) is not None:
                title = getattr(one, "rich_help_panel", None) or "Other"
                sections.setdefault(title, []).append(record)
        for title, lines in sections.items():
            with formatter.section(title):
                formatter.write_dl(lines)

"""What `rig track` prints of a film that it followed a ball in."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

STATES = {
    "track": "followed",
    "coast": "carried on unseen",
    "search": "searched for",
    "lost": "lost",
}


def summary_words(summary: Mapping[str, Any], out: Path) -> list[str]:
    """Lines on the summary of `track_video`: the film, the ball, notes, where the files are."""
    frames, ball = summary["frames"], summary["ball"]
    wide, tall = summary["size_px"]
    skipped = [
        f"{summary[key]} {what}"
        for key, what in (
            ("duplicates", "repeated ones skipped"),
            ("dropped", "dropped"),
            ("missing", "not decoded"),
        )
        if summary[key]
    ]
    more = f" ({', '.join(skipped)})" if skipped else ""
    time = ""
    if summary["start_s"] is not None:
        time = f", {summary['start_s']:.2f} to {summary['end_s']:.2f} s"
    lines = [f"{summary['address']}: {frames} frames{more} of {wide} x {tall} px{time}"]
    said = [f"{words} in {n}" for state, words in STATES.items() if (n := summary["states"][state])]
    of = "" if ball["radius_px"] is None else f" (radius {ball['radius_px']:.1f} px)"
    lines.append(f"ball{of}: {', '.join(said) or 'no frames'} of {frames} frames")
    lines += [f"note: {note}" for note in summary["notes"]]
    return [*lines, f"files in {out}: {', '.join(summary['files'])}"]

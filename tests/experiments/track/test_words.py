"""`rig track` says in words what it found, and where its files are."""

from pathlib import Path

from experiments.track.words import summary_words

SUMMARY = {
    "address": "ball.mp4",
    "size_px": [640, 480],
    "frames": 181,
    "duplicates": 166,
    "dropped": 0,
    "missing": 0,
    "states": {"search": 20, "track": 161, "coast": 0, "lost": 0},
    "start_s": 0.0,
    "end_s": 6.57,
    "ball": {"asked_colour": None, "bgr": [1.0, 2.0, 3.0], "radius_px": 14.21},
    "files": ["track.csv", "overlay.mp4"],
    "notes": ["pixels only"],
}


def test_frames_states_notes_and_the_folder_are_said():
    assert summary_words(SUMMARY, Path("out/track")) == [
        "ball.mp4: 181 frames (166 repeated ones skipped) of 640 x 480 px, 0.00 to 6.57 s",
        "ball (radius 14.2 px): followed in 161, searched for in 20 of 181 frames",
        "note: pixels only",
        "files in out/track: track.csv, overlay.mp4",
    ]


def test_a_film_without_a_frame_or_a_ball_is_told_as_such():
    nothing = {"frames": 0, "duplicates": 0, "states": dict.fromkeys(SUMMARY["states"], 0)}
    ball = {"ball": {"asked_colour": None, "bgr": None, "radius_px": None}}
    lines = summary_words(SUMMARY | nothing | ball | {"start_s": None, "end_s": None}, Path("o"))
    assert lines[:2] == ["ball.mp4: 0 frames of 640 x 480 px", "ball: no frames of 0 frames"]

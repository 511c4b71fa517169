"""What the shapes and colours of the 3-D view mean, in words for the tab Legend."""

TABLE = """
**Grey plate, orange ball**: the table as it is measured. Its trail is where the ball was, the
**target** is where it shall be.

**Blue ball**: the model, driven by the same volts. "model off by 3 mm" is how far the two balls
are apart: what the model does not know.

**Blocks beside the servos**: the play of gear and joint, 40 times as large. The **yellow** tooth
moves between two jaws: a **grey** jaw is free, a **red** one is touched.
"""
VIRTUAL = """
"gear x: 1.0°, found 0.9°": the virtual table has 1.0 degrees of play; 0.9 is what the controller's
observer has found of it while it moves ("-": nothing yet).
"""
REAL = """
"gear x: 1.0°, found 0.9°": the rig file says 1.0 degrees of play; 0.9 is what the controller's
observer has found while it moves ("-": nothing yet).
"""
CURVES = """
**Curves**: estimated shaft torque is what the controller's observer takes the twisted shafts to
pass on; estimated play is what that observer has found, gear full, joint dashed.
"""
FILMS = """
**Two small plates behind** (tab Gap, before and after): the model without and with the named
effect, at the same moment of the recorded run; "off by" is the distance to the recorded ball.

**Coloured cells on the plate**: how far model and recording disagree there, in units of what even
a perfect model would leave (noise floors).
"""


def legend_words(real: bool) -> str:
    """Markdown."""
    paragraphs = TABLE + (REAL if real else VIRTUAL) + CURVES + FILMS
    return "\n\n&nbsp;\n\n".join(paragraphs.strip().split("\n\n"))

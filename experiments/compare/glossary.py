"""What each condition of a comparison is, in a line."""

from collections.abc import Iterable

RETUNED, UNKNOWN = "retuned ...", "a compensator that was added here"
CONDITIONS = {
    "without": "PID alone, no compensation: what all others are tested against",
    "with": "the paper's model: the joint's play undone on the servo's reference, the gear's "
    "by extra volts",
    "sham": "the inverse of with in the wrong direction: control for its shaking and its gain at "
    "reversals",
    "misplaced": "the gear's play undone on the reference, too, where the loop already sees "
    "the load",
    "smooth": "feedforward inverse without a jump, u + alpha tanh(k u') (Zhou, Zhang and Wen 2007)",
    "adaptive": "inverse whose break points are adapted to the ball's error "
    "(Tao and Kokotovic 1993)",
    "adaptive-asymmetric": "the same with the two break points adapted apart",
    "hybrid": "sliding mode in contact, a soft landing across the gap (Nordin and Gutman 2002)",
    "neural": "dynamic inversion, a small network learns what is left (Selmic and Lewis 2000)",
    "disturbance": "disturbance observer on the motor, play unknown to it (Ohnishi 1987)",
    "lqg": "no PID: linear-quadratic regulator on a steady-state Kalman filter (Kalman 1960)",
    "mpc": "no PID: the same filter, volts and angle planned 0.5 s ahead within their limits "
    "(Rawlings and Mayne 2009)",
    RETUNED: "PID alone with other gains, P [rad/m] and D [rad s/m]: rivals at equal servo "
    "activity",
}


def glossary(conditions: Iterable[str]) -> list[list[str]]:
    """Rows (condition, definition) of these conditions; retuned PIDs share one row."""
    names = [RETUNED if name.startswith("retuned ") else name for name in conditions]
    return [[name, CONDITIONS.get(name, UNKNOWN)] for name in dict.fromkeys(names)]

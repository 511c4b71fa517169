"""Which regime a table is in: whether its plate keeps its place inside the joint's play.

Friction in the plate's pivots decides against the ball's weight, and it is an assumed number: what
is said here follows from the rig file, not from the run. In between, neither of the observer's two
plate models is right (see `tests/benchmarks/control/regime.py`).
"""

from rig.parameters import GRAVITY_M_S2, Rig
from rig.rigfile import from_dict

KEEPS = "friction in the joints holds the loose plate in its place inside the play"
DROPS = "the plate drops inside the play to the ball's side"
BETWEEN = (
    "between the two regimes: the ball moves the plate at times, and the play that the observer "
    "finds is too low"
)
FAR_OUT_M = 0.10  # a ball as far out as protocols put it for long


def ball_torque_nm(rig: Rig) -> float:
    """Torque [N m] at the servo shaft of a ball at FAR_OUT_M: m g (2 R_d/L) FAR_OUT_M."""
    return rig.ball.mass_kg * GRAVITY_M_S2 * rig.linkage.ratio * FAR_OUT_M


def regime(rig: Rig) -> str:
    """Regime of the rig's plate inside the joint's play: KEEPS, DROPS or BETWEEN.

    The ratio of joint friction to `ball_torque_nm` decides. KEEPS (2 or more, or no ball): friction
    holds the plate in place inside the play. DROPS (0.5 or less): the plate drops to the ball's
    side. BETWEEN: the ball moves the plate at times.
    """
    share = rig.drive.joint_friction_nm / ball_torque_nm(rig) if rig.ball.mass_kg > 0 else 2.0
    if share >= 2.0:
        return KEEPS
    return BETWEEN if share > 0.5 else DROPS


def regime_sentence(rig: Rig, what: str = "On this table") -> str:
    """One sentence: the regime after the label `what`, and the two torques that decide it."""
    return (
        f"{what}: {regime(rig)} (friction in the joints "
        f"{rig.drive.joint_friction_nm:.3g} N m, assumed; weight of a ball "
        f"{100 * FAR_OUT_M:.0f} cm out {ball_torque_nm(rig):.2g} N m, both at the servo)."
    )


def regime_of_record(rig: dict | None) -> str:
    """The sentence of `regime_sentence` for the rig that a run's start record holds.

    rig: the record's "rig" (as `rig.rigfile.to_dict` writes it); keys that this version does not
    know are ignored. Without one the sentence says that the regime is not known.
    """
    if not rig:
        return "Whether friction holds the loose plate is not known: the run folder holds no rig."
    return regime_sentence(rig_of_record(rig), "On this table, if its joints have play")


def rig_of_record(rig: dict) -> Rig:
    """Servo, ball, linkage and drive of the rig that a run's start record holds; what it lacks has
    its default, and keys that this version does not know are ignored. ValueError (one line): a
    value cannot be used.
    """
    told = {}
    for section in ("servo", "ball", "linkage", "drive"):
        given = rig.get(section, {})
        known = vars(getattr(Rig(), section))
        told[section] = (
            {k: v for k, v in given.items() if k in known} if isinstance(given, dict) else given
        )
    try:
        return from_dict(told)
    except ValueError as error:
        raise ValueError(f"the rig of run.json cannot be used: {error}") from None

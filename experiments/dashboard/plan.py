"""What is to be run, leg by leg, and how far it has come."""

from dataclasses import dataclass

from experiments.protocol import Protocol


@dataclass(frozen=True)
class Plan:
    """A protocol's arms and repetitions. pause: wait for the operator between runs; by_hand: the
    operator at the page places and lets go; speed: of the virtual table's time."""

    protocol: Protocol
    arms: tuple[str, ...]
    repetitions: int
    seed: int
    pause: bool = False
    by_hand: bool = False
    speed: float = 1.0


@dataclass(frozen=True)
class Leg:
    """One run of a plan."""

    plan: Plan
    arm: str
    seed: int
    number: int
    of: int

    @property
    def words(self) -> str:
        return f"{self.plan.protocol.name}, {self.arm} the model, seed {self.seed}"


def legs(plan: Plan) -> list[Leg]:
    """Every repetition of every arm in turn; a seed's arms get the same course."""
    pairs = [(plan.seed + i, arm) for i in range(plan.repetitions) for arm in plan.arms]
    return [Leg(plan, arm, seed, n, len(pairs)) for n, (seed, arm) in enumerate(pairs, 1)]


@dataclass(frozen=True)
class Status:
    """What the session does. state: starting, balancing, running, pause or stopped; t_s: of the
    present run's time; asked: what the operator shall do now."""

    state: str
    words: str = ""
    leg: Leg | None = None
    t_s: float = 0.0
    asked: str = ""

    @property
    def whole_s(self) -> float:
        """How long the present run takes."""
        if self.leg is None:
            return 0.0
        protocol = self.leg.plan.protocol
        return protocol.duration_s + (0.0 if protocol.servo_only else protocol.start.hold_s)

    @property
    def share(self) -> float:
        """Of the whole plan, 0 to 1."""
        if self.leg is None:
            return 0.0
        part = min(self.t_s / self.whole_s, 1.0) if self.whole_s else 0.0
        return (self.leg.number - 1 + part) / self.leg.of

    @property
    def left_s(self) -> float:
        """Wall time until the plan's end, without pauses."""
        if self.leg is None:
            return 0.0
        return self.leg.of * self.whole_s * (1 - self.share) / self.leg.plan.speed

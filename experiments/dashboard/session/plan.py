"""Plan of runs, its single runs in order, and the status of the session."""

from dataclasses import dataclass

from experiments.runs.protocol import Protocol
from rig.operator import Operator

METHOD_WORDS = {"with": "with play compensation", "without": "without play compensation"}


@dataclass(frozen=True)
class RunPlan:
    """A protocol to run with each of `methods` (compensators), `repetitions` times.

    pause: wait for the operator between runs; by_hand: the operator at the page places the ball
    and lets it go; speed: of the virtual table's time against wall time.
    """

    protocol: Protocol
    methods: tuple[str, ...]
    repetitions: int
    seed: int
    pause: bool = False
    by_hand: bool = False
    speed: float = 1.0


@dataclass(frozen=True)
class PlannedRun:
    """Run `number` (from 1) of the `of` runs of a plan."""

    plan: RunPlan
    method: str
    seed: int
    number: int
    of: int

    @property
    def words(self) -> str:
        """Protocol, method and seed, for a line on the page."""
        return f"{self.plan.protocol.name}, {METHOD_WORDS[self.method]}, seed {self.seed}"

    def ended(self, outcome: str, reason: str, t_s: float) -> str:
        """A sentence on how this run ended after t_s [s], "" where it was completed."""
        if outcome == "completed":
            return ""
        which = f"Run {self.number} of {self.of}"
        if not reason.startswith("stopped by"):
            return f"{which} failed after {t_s:.1f} s and does not count: {reason or outcome}."
        begun = ""
        if self.number + 1 == self.of:
            begun = f"; run {self.of} was not begun"
        elif self.number < self.of:
            begun = f"; runs {self.number + 1} to {self.of} were not begun"
        return f"{which} was {reason} after {t_s:.1f} s and does not count{begun}."


def planned_runs(plan: RunPlan) -> list[PlannedRun]:
    """The runs of a plan: for each seed every method in turn, on the same course."""
    pairs = [(plan.seed + i, method) for i in range(plan.repetitions) for method in plan.methods]
    return [
        PlannedRun(plan, method, seed, n, len(pairs)) for n, (seed, method) in enumerate(pairs, 1)
    ]


@dataclass(frozen=True)
class SessionStatus:
    """What the session does.

    state: starting, balancing, running, pause or stopped; after STOP until then: stopping (the
    plate is levelled) and at rest (0 V; the recording is finished); words: the same for a person;
    run: the present run or, in a pause, the next; t_s: time of the present run, which stands still
    while the operator is waited for; operator_step: what the operator has to do now, "" for
    nothing; waited_s: for how long the operator has been waited for, None where nobody is; last:
    how the last run ended, "" where it was completed.
    """

    state: str
    words: str = ""
    run: PlannedRun | None = None
    t_s: float = 0.0
    operator_step: str = ""
    waited_s: float | None = None
    last: str = ""

    @property
    def patience_s(self) -> float:
        """For how long the operator is waited for [s]."""
        hold_s = self.run.plan.protocol.start.hold_s if self.run else 0.0
        return hold_s + Operator.release_limit_s

    @property
    def duration_s(self) -> float:
        """Duration of the present run in the table's time [s]; 0 without one."""
        if self.run is None:
            return 0.0
        protocol = self.run.plan.protocol
        return protocol.duration_s + (0.0 if protocol.servo_only else protocol.start.hold_s)

    @property
    def share(self) -> float:
        """Share of the plan that is done, 0 to 1; 0 without a plan."""
        if self.run is None:
            return 0.0
        part = min(self.t_s / self.duration_s, 1.0) if self.duration_s else 0.0
        return (self.run.number - 1 + part) / self.run.of

    @property
    def remaining_s(self) -> float:
        """Wall time to the end of the plan without pauses [s]."""
        if self.run is None:
            return 0.0
        return self.run.of * self.duration_s * (1 - self.share) / self.run.plan.speed

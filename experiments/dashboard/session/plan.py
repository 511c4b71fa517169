"""Plan of runs, its single runs in order, and the status of the session."""

from dataclasses import dataclass
from itertools import accumulate

from experiments.runs.protocol import Protocol, read_protocol
from rig.operator import Operator

METHODS = {
    "both, one after the other": ("without", "with"),
    "with play compensation": ("with",),
    "without": ("without",),
}
BOTH = next(iter(METHODS))
# What the other tabs need of runs, one after the other: Figs. 10 and 11, 12 and 13, and what a gap
# analysis asks for.
STUDY = ("free-release", "pushed", "steps", "servo-squares")
WHOLE = "the whole study"
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

    @property
    def run_s(self) -> float:
        """Duration of one run in the table's time [s]."""
        hold_s = 0.0 if self.protocol.servo_only else self.protocol.start.hold_s
        return self.protocol.duration_s + hold_s


def shipped_plan(name: str, choice: str, repetitions: int) -> RunPlan:
    """The runs of a shipped protocol; choice: a key of METHODS. Both methods are run where the
    protocol asks for both: on the servos alone they record the same.
    """
    protocol = read_protocol(name)
    methods = tuple(m for m in METHODS[choice] if choice != BOTH or m in protocol.arms)
    return RunPlan(protocol, methods, repetitions, protocol.seed)


@dataclass(frozen=True)
class PlannedRun:
    """Run `number` (from 1) of the `of` runs that were asked for; before_s, all_s: durations [s] of
    those before it, and of all of them.
    """

    plan: RunPlan
    method: str
    seed: int
    number: int
    of: int
    before_s: float
    all_s: float

    @property
    def words(self) -> str:
        """Protocol, method and seed, for a line on the page."""
        return f"{self.plan.protocol.name}, {METHOD_WORDS[self.method]}, seed {self.seed}"

    def ended(self, outcome: str, reason: str, t_s: float) -> str:
        """A sentence on how this run ended after t_s [s]; where it was completed on the last one of
        the plan, else "".
        """
        if outcome == "completed":
            many = {1: "The run is", 2: "Both runs are"}.get(self.of, f"All {self.of} runs are")
            return f"{many} done: see the tab Results." if self.number == self.of else ""
        which = f"Run {self.number} of {self.of}"
        if not reason.startswith("stopped by"):
            return f"{which} failed after {t_s:.1f} s and does not count: {reason or outcome}."
        begun = ""
        if self.number + 1 == self.of:
            begun = f"; run {self.of} was not begun"
        elif self.number < self.of:
            begun = f"; runs {self.number + 1} to {self.of} were not begun"
        return f"{which} was {reason} after {t_s:.1f} s and does not count{begun}."


def planned_runs(*plans: RunPlan) -> list[PlannedRun]:
    """The runs of these plans in turn: for each seed every method, on the same course."""
    runs = [
        (plan, method, plan.seed + i)
        for plan in plans
        for i in range(plan.repetitions)
        for method in plan.methods
    ]
    ends_s = list(accumulate((run[0].run_s for run in runs), initial=0.0))
    return [
        PlannedRun(*run, number, len(runs), before_s, ends_s[-1])
        for number, (run, before_s) in enumerate(zip(runs, ends_s, strict=False), 1)
    ]


@dataclass(frozen=True)
class SessionStatus:
    """What the session does.

    state: starting, balancing, running, pause or stopped; after STOP until then: stopping (the
    plate is levelled) and at rest (0 V; the recording is finished); words: the same for a person;
    run: the present run or, in a pause, the next; t_s: time of the present run, which stands still
    while the operator is waited for; operator_step: what the operator has to do now, "" for
    nothing; waited_s: for how long the operator has been waited for, None where nobody is; last:
    how the last run ended, "" where it was completed; begun: its first row has come.
    """

    state: str
    words: str = ""
    run: PlannedRun | None = None
    t_s: float = 0.0
    operator_step: str = ""
    waited_s: float | None = None
    last: str = ""
    begun: bool = True

    @property
    def shown(self) -> str:
        """The state for a person (a key of `tabs.header.STATES`): a run whose loop is being started
        has not begun."""
        return "run starting" if self.state == "running" and not self.begun else self.state

    @property
    def heading(self) -> str:
        """What is on, for a line above the events of its time."""
        if self.run is not None and self.state == "running":
            return f"run {self.run.number} of {self.run.of}: {self.of}"
        return "between runs" if self.state == "pause" else self.of or "no run"

    @property
    def of(self) -> str:
        """What the table does, for a line on the page: run or balancing; "" for neither."""
        if self.run is not None and self.state == "running":
            return f"{self.run.plan.protocol.name}, {METHOD_WORDS[self.run.method]}"
        return f"balancing, {METHOD_WORDS['without']}" if self.state == "balancing" else ""

    @property
    def patience_s(self) -> float:
        """For how long the operator is waited for [s]."""
        hold_s = self.run.plan.protocol.start.hold_s if self.run else 0.0
        return hold_s + Operator.release_limit_s

    @property
    def duration_s(self) -> float:
        """Duration of the present run in the table's time [s]; 0 without one."""
        return self.run.plan.run_s if self.run else 0.0

    @property
    def share(self) -> float:
        """Share of the plan that is done, 0 to 1; 0 without a plan."""
        if self.run is None:
            return 0.0
        return (self.run.before_s + min(self.t_s, self.duration_s)) / max(self.run.all_s, 1e-9)

    @property
    def remaining_s(self) -> float:
        """Wall time to the end of the plan without pauses [s]."""
        if self.run is None:
            return 0.0
        return self.run.all_s * (1 - self.share) / self.run.plan.speed

"""The rule by which an effect is named: every number that decides, in one place.

Gains G are differences of log-likelihood between two fits (`calibration.gap.model.fit`). k released
parameters are paid for before a gain counts; what is left is the score

    S = G - (PENALTY_PER_PARAMETER + MISFIT_SHARE max(G, 0)) k.

The thresholds below are applied to S unless "gain" is said. Each line says what its number decides;
a number marked "chosen" has no derivation: its value is the one with which simulated tables were
named rightly (README.md of this folder: tuning data against test data).
"""

import numpy as np

# --- what a parameter costs -------------------------------------------------------------------
PENALTY_PER_PARAMETER = 3.0  # BIC's ln(n)/2 for n = 400 independent samples; chosen
MISFIT_SHARE = 0.004  # of the gain, per parameter: a nearly right model leaves as much; chosen

# --- naming: what has to be reached ---------------------------------------------------------------
# With PENALTY_PER_PARAMETER a gain of 8: chi-square of 16 on 1 degree of freedom, p = 6e-5; for
# about 50 effects and axes a false alarm in 0.3 % of logs, if the model were exact.
NAME_THRESHOLD = 5.0
# A second dry friction on one axis is nearly collinear with the first, so more is asked; chosen.
RELATED_FRICTION_THRESHOLD = 15.0
DRY_FRICTIONS = ("coulomb_friction", "stribeck_friction", "dead_zone")
RIVAL_MARGIN = 5.0  # two names that differ by less are reported as "A or B"; chosen
MIN_SHARE_OF_TOTAL = 0.05  # of the summed score: an addition below may be an unnamed term; chosen
MIN_SHARE_ON_OUTPUT = 0.01  # of the score named on one output: below, errors of the model; chosen
MAX_EFFECTS = 7  # names at most; chosen
PROBABILITY_TEMPERATURE = 2.0  # probability ~ exp(-margin/T): T > 1 as samples correlate; chosen

# --- naming: is the fitted effect what its name says? ---------------------------------------------
MIN_TOLERANCE_RATIO = 1.2  # fitted size over the tolerance; chosen
# Minimum size of an effect without a tolerance [unit of its first parameter]: below it, the effect
# cannot be told from errors of other parameters within their tolerances; chosen.
MIN_EFFECT_SIZE = {
    "stribeck_friction": 0.018, "viscous_asymmetry": 0.012, "cogging": 0.015, "gain_drift": 8e-4,
    "supply_sag": 0.0105,
    "gear_backlash": 0.0012, "transmission_ripple": 0.0015, "linkage_cubic": 0.25,
    "level_drift": 8e-6, "plate_bowl": 0.015, "viscous_drag": 0.014, "lens_distortion": 0.3,
}  # fmt: skip
# Phase that the motion has to span [rad]: less of a period is a curve, as of a cable that pulls.
MIN_PHASE_RAD = {"cogging": 5.0, "transmission_ripple": 2.0}  # chosen
MAX_STRIBECK_SPEED_SHARE = 0.4  # of the fastest motion: beyond, friction hardly falls; chosen
# Dry friction that settles with the motor's own time constant is a dead zone, in every term of the
# equations; with less of it, it is friction. Chosen: nearer to it than fits of either come.
MAX_SETTLING_SHARE = 0.75
MIN_SHARE_BELOW_LIMIT = 0.05  # of the volts that turn a motor, to tell a limit from a gain; chosen
MAX_SATURATION_RATIO = 1.03  # limit over the largest volts: beyond, hardly any were cut; chosen

# --- the threshold that chance sets on this log (bootstrap) ---------------------------------------
CHANCE_ONE_IN = 100  # a name's score is exceeded by chance in 1 of so many logs: 1 %
BOOTSTRAP_DRAWS = 300  # of the linear screen, so that 3 of them lie beyond; chosen
MIN_BLOCKS = 12  # of time, on a short log: 2^12 patterns of signs; chosen

# --- the veto of data that were not fitted (veto.py) ----------------------------------------------
MIN_WINDOWS = 8  # predictions 1 s ahead: with fewer their mean says nothing; chosen
OUTLIER_SHARE, OUTLIER_RATIO = 0.95, 3.0  # a quantile of errors, bounded at thrice: pushes; chosen
# Of an output's names (specification.py): below, something else acts. Chosen.
MIN_COMPLETENESS = 0.8
FAMILY_P = 1e-4  # tail of each of about 100 tests of a log's names: 1 in CHANCE_ONE_IN logs
# Deviation from a straight line in time, RMS, as a share of the line's own, of a drift that one run
# tells: 1 in CHANCE_ONE_IN random walks is as straight (by polynomials up to the ninth order).
MAX_UNEVENNESS = 0.19
MAX_INCONSTANCY = 0.25  # by which a size has to differ as well, since no model is exact; chosen
CANCELLED_SHARE = 1 / 3  # of a lag that a dead time takes back: another answer's shape; chosen
# Of a name whose size is no constant, or whose gain 1 s ahead is not certain: as likely something
# else. Chosen.
DOUBTED_PROBABILITY = 0.5
SURE_Z = 2.0  # standard errors by which a rival has to predict better, 2.3 % by chance; chosen
MAX_ROUNDS = 3  # of naming, while every name was refuted; chosen
RANGE_END_STEPS = 0.01  # of a parameter's step: closer to its range's end, it is at the end

# --- what has no name -----------------------------------------------------------------------------
UNNAMED_THRESHOLD = 8.0  # score of an unnamed term; chosen
UNNAMED_SHARE = 1.0  # of that score which a name has to keep beside the term; chosen
SEARCH_PENALTY = 7.0  # log-likelihood for the choice among about e^7 = 1100 frequencies or windows
MIN_FELT = {"ball": 0.0015, "servo": 0.025}  # RMS [m/s2, V]: tolerances of rolling and of friction

# --- which model stands before any name -----------------------------------------------------------
ASSUMED_FRICTION_ERROR = 0.015  # relative error of the assumed friction of arm and joints; chosen
# A servo creeps that stays for CREEP_QUANTILE of its time below CREEP_SPEED_SHARE of the speed
# which the volts of the assumed friction would give; chosen.
CREEP_QUANTILE, CREEP_SPEED_SHARE = 0.95, 0.75

# --- what is refitted at all (saves work; whether it is inert is not shown) -----------------------
EFFECTS_REFITTED = 5  # the best of the screen
RIVALS_REFITTED = 3  # in the place of an accepted name
MIN_REFIT_GAIN = 4.0  # screened gain below which an effect is not refitted
MIN_SHARE_OF_BEST = 0.1  # of the best screened gain on its side of the table, likewise
MIN_LATE_REFIT_GAIN = 12.0  # for a lower-ranked effect, while no better one kept its screened gain
MIN_AXIS_GAIN = 6.0  # screened gain on an axis for the effect to be released there
MIN_SHARE_OF_BEST_ON_AXIS = 0.8  # of the best effect's screened gain on that axis, likewise
CERTAIN_GAIN = 50.0  # beyond it something is missing for certain: costly starts are tried, too
# Process noise [V/sqrt(Hz)] beyond which a model without dead zone may have failed: ten times the
# usual.
FAILED_MODEL_NOISE_V = 0.01
DETECTABLE_GAIN = 12.0  # gain at which an effect would have shown: 1/2 (sqrt(2 8) + 0.9)^2, 82 %


def is_certain(falls: np.ndarray) -> bool:
    """Whether the falls of the cost by blocks (B,) sum to more than SURE_Z of their standard errors
    (Vuong, Econometrica 57, 1989)."""
    return bool(falls.sum() > SURE_Z * np.sqrt(len(falls)) * falls.std())


def penalised_gain(gain, parameters: int):
    """Score S = G - (PENALTY_PER_PARAMETER + MISFIT_SHARE max(G, 0)) k of gains G in log-likelihood
    (scalar or array) for which k = `parameters` were released; of the shape of `gain`."""
    kept = np.minimum(gain, 0.0) + (1.0 - MISFIT_SHARE * parameters) * np.maximum(gain, 0.0)
    return kept - PENALTY_PER_PARAMETER * parameters  # of an infinite gain, infinite

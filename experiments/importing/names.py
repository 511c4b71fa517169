"""What a column's name says: its role, its axis, its unit. A name may say nothing, or lie."""

import re
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise

from experiments.importing.units import canonical, quantity

WORDS = {
    "time": "t time zeit tempo temps tiempo tid tijd timestamp stamp clock elapsed tout date "
    "datetime millis micros epoch datum uhrzeit zeitpunkt zeitstempel heure horodatage hora "
    "fecha "
    "czas zaman время 時間 時刻 时间",
    "ball": "xb yb obj object ball kugel palla bille balle bola bal kula marble sphere blob "
    "centroid esfera balón bolita "
    "kulka kulki piłka piłki шар шарик мяч ボール 小球 球",
    "place": "pos position lage ort point xy pv touch touchscreen touchpad "
    "pozycja położenie konum положение позиция 位置 座標 坐标",
    "target": "target set setpoint sp ref des soll goal want wanted sollwert rif objetivo alvo "
    "referência doel "
    "hedef 目標 目标 設定 设定",
    "angle": "angle theta servo tilt winkel alpha beta roll pitch arm phi platte plate "
    "plat actuator stepper brazo placa plateau servomotor rotation rotazione rotacion rotación "
    "hoek plaat neigung platten pan "
    "θ ϑ φ α β kąt serwo serwa açı угол серво сервопривод サーボ 舵机 舵機 角度 傾斜 倾角",
    "command": "cmd mv action out output ctrl control applied stellwinkel mando orden saida "
    "saída uitgang pulse pulses pulsewidth impuls impulsion impulso pulso "
    "komut komenda команда 指令 命令",
    "measured": "meas actual act ist enc feedback present state real fb joint imu mpu "
    "inclinometer gemeten "
    "実測 実際 实测 实际 测量 反馈",
    "voltage": "vm spannung tension tensión tensione tensao tensão spanning "
    "napięcie gerilim напряжение 電圧 电压",
    "share": "pwm duty dutycycle",
    "current": "current amp amps strom stroom im corrente prąd akım ток 電流 电流",
    "speed": "speed vel omega gyro dot rpm tacho tach rate hız 速度",
    "derived": "filt est kalman kf pred hat lpf model sim 滤波 フィルタ",
    "other": "error err fehler errore erro fout integral gain kp ki kd temperature temp battery "
    "loop fps count counter index frame id seq sequence nr covariance cov z reward done "
    "torque effort force moment load current_draw trim bias vx vy xdot ydot mps mmps cmps "
    "błąd uchyb hata ошибка 誤差 误差",
    "motor": "motor",
    "session": "run trial session episode take versuch lauf durchgang essai prueba ensayo prova",
    "likelihood": "likelihood likelihoods conf confidence confidences score scores prob probs "
    "probability certainty confiance confianza confidenza wahrscheinlichkeit",
    "size": "radius area diameter",
    "unseen": "lost missed missing occluded undetected stale verloren verdeckt perdu perdue "
    "perdido perso verlies",
    "seen": "detected found visible seen valid tracked erkannt gefunden sichtbar gueltig gültig "
    "detecte detecté détecté trouve trouvé trovato visto valido detectado encontrado gezien "
    "gevonden",
}
_ROLES = {word: role for role, words in WORDS.items() for word in words.split()}
STEMS = {  # of words that languages end in many ways
    "command": "comand command kommand mandad stell actuat attuat angesteuert",
    "measured": "measur gemess mesur misur medid rilev encoder zmierz ölçül измерен",
    "target": "sollw consign desir desej desead gewens refer rifer zadan задан",
    "ball": "kugel pelot pallin",
    "place": "posi",
    "angle": "angol angul ángul ângul neigung inclin kipp winkel",
    "derived": "estim filter filtr smooth predict фильтр",
    "speed": "veloc geschwind vitess snelh prędko скорост",
    "voltage": "volt spannung",
}
FLAGS = {"seen", "unseen"}  # that there was a ball, or none
TELLING = FLAGS | {"likelihood", "size"}
DETECTORS = {  # words of what sees a ball, or of what it sees
    *"detection detector detect track tracker tracking camera cam vision image img picture".split(),
    *"blob circle contour marble object instance keypoint pose touch status flag".split(),
    *"is was has no".split(),
}
STATES = {  # words of a tracker about its ball, in a column of words
    **dict.fromkeys("tracked tracking found detected seen visible ok good valid locked".split(), 1),
    **dict.fromkeys("lost missing undetected occluded invalid searching bad predicted".split(), 0),
    **dict.fromkeys(("not found", "not_found", "notfound", "not detected", "no ball"), 0),
}
YES = {
    **dict.fromkeys("yes ja oui sí si sim".split(), 1),
    **dict.fromkeys("no nein non não nee".split(), 0),
}
STATED = "{} [seen]"  # the name of such a column, as of 1 and 0
_AXES = {
    **dict.fromkeys(("x", "1", "u", "cx", "xb", "bx", "px"), "x"),
    **dict.fromkeys(("y", "2", "v", "cy", "yb", "by", "py"), "y"),
    **dict.fromkeys(("roll", "alpha", "α"), "x"),
    **dict.fromkeys(("pitch", "beta", "β"), "y"),
}
PLAIN = {"x", "y", "cx", "cy", "bx", "by", "px", "py"}
SEEN_AS = {"real", "act", "actual", "ist", "meas", "measured", "gemessen"}  # x and y of the ball
PLAIN_UNITS = {
    *"deg degrees rad radians mm cm ms us volts px derece stopnie град рад мм см мс".split()
}
CLEAR_ANGLE = "angle theta tilt alpha beta roll pitch phi θ ϑ α β φ".split()
_POSITION = {"position", "pos"}
_QUATERNION = ("x", "y", "z", "w")
_NUMBERING = {"number", "num", "no", "nr", "id", "index", "idx"}
_IDEOGRAPHS = "\u3040-\u30ff\u4e00-\u9fff"  # and kana: words without a space between them
_UNSPACED = re.compile(
    "|".join(sorted((w for w in _ROLES if re.match(f"[{_IDEOGRAPHS}]", w)), key=len, reverse=True))
)
_BRACKETS = re.compile(r"[\[({<]\s*([^\])}>]{1,12})\s*[\])}>]")
_SIZED = re.compile(r"(.*?)([\s_]*([(\[{<])?[*x·×/]\s*)?(10+)(?(3)[\])}>])\s*")


@dataclass(frozen=True)
class Hint:
    """What a name says. role: time, ball, target, theta, command, angle (commanded or measured is
    open), speed, voltage, share, current, session, one of TELLING, or other; axis: x, y
    or none; clear: the word for an angle is one that nobody gives to a share or a count; derived:
    filtered or estimated by somebody's program; explicit: a word for the ball stands in it.
    """

    role: str | None
    axis: str | None
    unit: str | None
    clear: bool = False
    derived: bool = False
    explicit: bool = False


def hints(names: Iterable[str], units: Mapping[str, str]) -> dict[str, Hint]:
    """What each of a file's names says, of which some tell what others mean: `roll_d` is the
    desired roll, but beside `roll_p` the derivative's share, and beside `roll_c` the fourth; beside
    `present_position` a position is a servo's, as bus servos call it; x, y, z and w of one stem are
    parts of a quaternion, no angles and no places (a box in a picture has x, y, w and h); beside
    an angle in another unit a pulse's width is a command."""
    split = {name: words_of(name) for name in names}
    others = {tuple(w[:i]) for w in split.values() for i in _letters(w) if w[i] != "d"}
    parts = Counter(tuple(w[:-1]) for w in split.values() if w and w[-1] in _QUATERNION)
    bus = any({"present", *_POSITION} & set(w) > {"present"} for w in split.values())
    read = {}
    for name, words in split.items():
        if words and words[-1] in _QUATERNION and parts[tuple(words[:-1])] == len(_QUATERNION):
            read[name] = Hint("other", None, None)
            continue
        servos = {"present", "goal"} & set(words) and _POSITION & set(words)
        if bus and servos and not any(_role_of(word) == "ball" for word in words):
            read[name] = hint(f"servo {name}", units.get(name))
            continue
        at = [i for i in _letters(words) if words[i] == "d" and tuple(words[:i]) not in others]
        read[name] = hint(f"desired {name}" if at else name, units.get(name))
    if any(one.role in ("angle", "theta") and one.unit != "us" for one in read.values()):
        pulses = [n for n, one in read.items() if one.role == "angle" and one.unit == "us"]
        read |= {name: replace(read[name], role="command") for name in pulses}
    return read


def is_strange(name: str) -> bool:
    """Whether a word that says nothing here stands in a name: `lost` of a `packet` is no ball's."""
    known = (_role_of(w) or w in _AXES or w in DETECTORS or canonical(w) for w in words_of(name))
    return not all(one or word.isdigit() for one, word in zip(known, words_of(name), strict=True))


def belongs(name: str, to: Iterable[str]) -> bool:
    """Whether a name (`corner1_likelihood`) begins as one of others, all but its last word."""
    stem = words_of(name)[:-1]
    return bool(stem) and any(words_of(other)[: len(stem)] == stem for other in to)


def _letters(words: list[str]) -> list[int]:
    """Where a single letter, no axis and no unit, stands behind other words."""
    return [
        i
        for i, word in enumerate(words)
        if i and len(word) == 1 and word.isalpha() and word not in _AXES and not canonical(word)
    ]


def hint(name: str, stated_unit: str | None = None) -> Hint:
    """What `name` (and the unit that the file gives for it, if any) says about a column."""
    unit = canonical(stated_unit) if stated_unit else None
    name, size = _size_behind(name)
    brackets = _BRACKETS.findall(name)
    bare = _BRACKETS.sub(" ", name)
    for inside in brackets:
        unit = unit or canonical(inside)
        if canonical(inside) is None:
            bare += " " + inside  # theta[1]: an index
    words = words_of(bare)
    unit = unit or _size_in_front(bare, _unit_at_end(bare, words) or _unit_within(words))
    unit = canonical(f"{unit}*{size}") or unit if size else unit
    roles = [role for word in words if (role := _role_of(word))]
    roles += ["angle"] * ("joint" in words)  # and measured
    if any(one == "load" and word in CLEAR_ANGLE for one, word in pairwise(words)):
        roles = ["measured", *(role for role in roles if role != "other")]  # behind the gear
    sayings = words[:-1] if unit and len(words) > 1 and canonical(words[-1]) == unit else words
    said = [word for word in reversed(sayings) if word in _AXES]
    said.sort(key=lambda word: word not in ("x", "y"))  # the pixel's u is a control's, too
    axis = _AXES[said[0]] if said else None
    role = _role(words, roles, unit)
    last = set(words_of(re.split(r"[./]", bare)[-1]))
    if role is None and last & PLAIN and last <= PLAIN | SEEN_AS:
        role = "ball"  # x and y alone
    clear = any(word.startswith((*CLEAR_ANGLE, *STEMS["angle"].split())) for word in words)
    return Hint(role, axis, unit, clear, "derived" in roles, "ball" in roles)


def _role_of(word: str) -> str | None:
    """The role that a word says, or the stem that it begins with."""
    stems = ((role, stem) for role, each in STEMS.items() for stem in each.split())
    begun = (role for role, stem in stems if word.startswith(stem))
    return _ROLES.get(word) or next(begun, None)


def words_of(name: str) -> list[str]:
    """Lower-case words of a name: at capitals, digits, and whatever is no letter."""
    name = re.sub(r"([a-zß-ÿа-яё])([A-ZÀ-ÞА-ЯЁ])", r"\1 \2", name)
    name = re.sub(r"(?<=[^\W\d_])(?=\d)|(?<=\d)(?=[^\W\d_])", " ", name)
    name = re.sub(f"(?<=[{_IDEOGRAPHS}])(?=[A-Za-z])|(?<=[A-Za-z])(?=[{_IDEOGRAPHS}])", " ", name)
    name = _UNSPACED.sub(r" \g<0> ", name)
    words = [word.lower() for word in re.split(r"(?:[^\w°%]|_)+", name) if word]
    return [word for one in words for word in _parts(one)]


def _parts(word: str) -> list[str]:
    """A word's parts where it is made of two that say something, or ends in an axis: `sollwinkel`,
    `posx`."""
    for i in range(len(word) - 1, 1, -1):
        first, last = word[:i], word[i:]
        if (
            word not in _ROLES
            and first in _ROLES
            and ((last in _ROLES and i > 2) or last in ("x", "y"))
        ):
            return [first, last]
    return [word]


def _unit_at_end(name: str, words: list[str]) -> str | None:
    """The unit in the last words of a name (`pos_x_mm`, `speed_rad_s`), if there is one.

    A single letter counts only behind a word: `x` is no unit, and v is a pixel's row. So does px
    behind an axis: of `ball_px` and `ball_py` it is the x.
    """
    if words and words[-1] == "px" and not _AXES.keys() & set(words[:-1]):
        return None
    for count in (3, 2):
        if len(words) > count and (unit := canonical("_".join(words[-count:]))):
            return unit
    if len(words) < 2:
        return canonical(words[0]) if words and len(words[0]) > 1 else None
    last = re.split(r"(?:[^\w°%]|_)+", name.strip())[-1]
    if last in ("V", "A", "m", "s", "м", "с") or len(words[-1]) > 1 or not words[-1].isalpha():
        return canonical(last) if not words[-1].isdigit() else None
    return None


def _size_in_front(name: str, unit: str | None) -> str | None:
    """The unit with the number that stands right before it in a name (`angle_x_0.1deg`)."""
    front = re.search(r"[\s_]([\d.,]+[A-Za-zµμ°]+)\s*$", name)
    whole = canonical(front[1]) if front else None
    return whole if whole and whole.endswith(f" {unit}") else unit


def _size_behind(name: str) -> tuple[str, str]:
    """A name without the number right behind its unit (`x_deg10`, `pos [mm] x10`), and that number.

    `servo_deg_10` is the tenth servo's, and `pos_x10 [mm]` a tenth place.
    """
    match = _SIZED.fullmatch(name)
    if match is None:
        return name, ""
    front, times, _, size = match.groups()
    if front.endswith(("]", ")", "}", ">")):
        unit = canonical(_BRACKETS.findall(front)[-1]) if _BRACKETS.search(front) else None
    else:
        words = words_of(front) if front[-1:].isalpha() or front[-1:] in ("°", "%") else []
        known = words and (times or len(words[-1]) > 1)  # m10 and v10 are numbered
        unit = _unit_at_end(front, words) if known else None
    return (front, size) if unit else (name, "")


def _unit_within(words: list[str]) -> str | None:
    """The one word of a name that can only be a unit (`servo_deg_cmd`)."""
    inner = words[1:-1] if words[-1:] == ["px"] else words[1:]  # at the end it may be an axis
    found = {canonical(word) for word in inner if word in PLAIN_UNITS}
    return found.pop() if len(found) == 1 else None


def _role(words: list[str], roles: list[str], unit: str | None) -> str | None:
    """The role of a column by the words of its name, then by its unit."""
    kind = quantity(unit) if unit else None
    has = set(roles)
    numbers = all(_role_of(word) == "session" or word in _NUMBERING for word in words)
    if "session" in has and numbers:
        return "session"
    beside = {"ball", "session", *(["measured"] * ("state" in words))}
    plain = has - beside - ({"place"} if "likelihood" in has else set())  # but detected_pos_x
    if len(plain) == 1 and plain <= TELLING:
        return plain.pop()
    if words and words[-1] in ("stamp", "timestamp"):
        return "time"
    if (
        "time" in has
        and not has & {"ball", "angle", "voltage", "target"}
        and kind in (None, "time")
    ):
        return "time"
    if has & {"other", "likelihood", "size"} or kind == "time":
        return "time" if kind == "time" and "other" not in has and words[:1] == ["t"] else "other"
    if kind == "current" or "current" in has:
        return "current"
    if "share" in has and unit == "us":
        return "command"  # a pulse's width, not a share of a supply
    if "share" in has and "angle" not in has:
        return "share"
    if kind == "voltage" or "voltage" in has:
        return "voltage"
    if kind == "speed" or ("speed" in has and kind is None):
        return "other" if has & {"ball", "place"} else "speed"
    if (
        kind == "angle"
        or (has & {"angle", "motor"} and kind is None)
        or (kind is None and "measured" in has and "enc" in " ".join(words))
    ):
        if "speed" in has:
            return "speed"
        u = "u" in words  # an input, as control theory calls it
        if (has & {"command", "target"} or (u and kind == "angle")) and "measured" not in has:
            return "command"
        return "theta" if "measured" in has and has & {"command"} == set() else "angle"
    if "speed" in has:
        return "other"
    if has & {"ball", "place"} or kind == "length":
        return "target" if "target" in has else "ball"
    if "command" in has and kind is None:
        return "command"
    return "target" if "target" in has and any(word in _AXES for word in words) else None

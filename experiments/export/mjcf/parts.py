"""What the parts of a MuJoCo model are made of: a document, and numbers as attributes."""

from dataclasses import dataclass, field
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from rig.parameters import Rig
from rig.plant.plant_record import STEP_S

LIGHT_KG, LIGHT_KG_M2 = 1e-4, 1e-7  # chosen: of bodies whose inertia stands in their joint
SOFT = 1e-3  # impedance of a limit that acts as a spring: 0.1 % of other forces leaks in
HARD = {"solref": f"{3 * STEP_S:g} 1", "solimp": "0.9999 0.9999 1"}


def numbers(*values: float) -> str:
    """Numbers as an attribute."""
    return " ".join(f"{float(v):.12g}" for v in values)


def add(parent: Element, tag: str, /, **attributes: object) -> Element:
    """A child of `parent`; a number or a tuple of numbers becomes text, None is left out."""
    text = {}
    for key, value in attributes.items():
        if isinstance(value, tuple):
            text[key] = numbers(*value)
        elif value is not None:
            text[key] = value if isinstance(value, str) else numbers(value)  # pyright: ignore
    return SubElement(parent, tag, text)


def light(body: Element) -> None:
    """An inertia that hardly counts."""
    i = LIGHT_KG_M2
    add(body, "inertial", pos=(0, 0, 0), mass=LIGHT_KG, diaginertia=(i, i, i))


def stiff(of: str) -> dict[str, str]:
    """Attributes of a hard constraint of a joint or tendon: of = "limit" or "friction"."""
    return {f"{key}{of}": value for key, value in HARD.items()}


def effect(rig: Rig, name: str, key: str, axis: str, null: float = 0.0) -> float:
    """Value of an effect of the rig on an axis ("x", "y" or "xy")."""
    return rig.effects.get(name, {}).get(axis, {}).get(key, null)


@dataclass
class Document:
    """A model that grows: its sections, and what it does not carry (`told`)."""

    root: Element
    world: Element = field(init=False)
    contact: Element = field(init=False)
    tendon: Element = field(init=False)
    equality: Element = field(init=False)
    actuator: Element = field(init=False)
    sensor: Element = field(init=False)
    told: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.world = SubElement(self.root, "worldbody")
        for name in ("contact", "tendon", "equality", "actuator", "sensor"):
            setattr(self, name, SubElement(self.root, name))

    def text(self, header: list[str]) -> str:
        """The XML with a comment on top; empty sections are left out."""
        for section in list(self.root):
            if len(section) == 0 and not section.attrib:
                self.root.remove(section)
        ElementTree.indent(self.root)
        said = "\n".join(f"  {line}".replace("--", "- -") for line in header)
        return f"<!--\n{said}\n-->\n{ElementTree.tostring(self.root, 'unicode')}\n"


def shaft(document: Document, rig: Rig, place: str, axis: str, ends: tuple[str, str], apart: float):
    """The gear's or the joint's shaft as a tendon between two hinges: elastic, or with play.

    ends: the driving and the driven hinge; apart: sum of their inverse inertias [1/(kg m2)], by
    which MuJoCo turns a limit's stiffness into an acceleration.
    """
    k = getattr(rig.drive, f"{place}_stiffness_nm_rad")
    c = getattr(rig.drive, f"{place}_damping_nm_s")
    play, centre = play_of(rig, place, axis)
    fixed = add(document.tendon, "fixed", name=f"{place}_{axis}")
    if play == 0:
        fixed.attrib |= {"stiffness": numbers(k), "damping": numbers(c), "springlength": "0"}
    elif rig.drive.shaft_model == "dead_zone":
        fixed.attrib |= {"stiffness": numbers(k)}
        fixed.attrib["springlength"] = numbers(centre - play / 2, centre + play / 2)
    else:
        fixed.attrib |= {"limited": "true", "range": numbers(centre - play / 2, centre + play / 2)}
        fixed.attrib |= {"solreflimit": numbers(-k * apart, -c * apart)}
        fixed.attrib |= {"solimplimit": numbers(SOFT, SOFT, 1)}
    for end, sign in zip(ends, (1, -1), strict=True):
        add(fixed, "joint", joint=f"{end}_{axis}", coef=sign)


def play_of(rig: Rig, place: str, axis: str) -> tuple[float, float]:
    """Full width and middle of the play of "gear" or "joint" on an axis [rad]."""
    if rig.drive.shaft_model == "none":
        return 0.0, 0.0
    name = f"{place}_backlash"
    return effect(rig, name, "play_rad", axis), effect(rig, name, "offset_rad", axis)

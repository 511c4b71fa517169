"""modelDescription.xml and buildDescription.xml of a table's FMU (FMI 3.0, co-simulation)."""

from math import isinf
from xml.etree import ElementTree

from experiments.export.fmu.variables import FALLEN, HELD, INPUT, OUTPUT, PARAMETER, Variable

IDENTIFIER = "balancing_table"
_KNOWN_UNITS = {  # exponents of the base units, as FMI wants them
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "1/V": {"kg": -1, "m": -2, "s": 3, "A": 1},
    "rad/(s.V)": {"kg": -1, "m": -2, "s": 2, "A": 1, "rad": 1},
    "m": {"m": 1},
    "kg": {"kg": 1},
    "s": {"s": 1},
    "1/s": {"s": -1},
    "1/s2": {"s": -2},
    "m/s": {"m": 1, "s": -1},
    "m/s2": {"m": 1, "s": -2},
    "rad": {"rad": 1},
    "1/rad": {"rad": -1},
    "1/rad2": {"rad": -2},
    "rad/s": {"rad": 1, "s": -1},
    "rad/s2": {"rad": 1, "s": -2},
    "N.m": {"kg": 1, "m": 2, "s": -2},
    "N.m/rad": {"kg": 1, "m": 2, "s": -2, "rad": -1},
    "N.m.s/rad": {"kg": 1, "m": 2, "s": -1, "rad": -1},
    "kg.m2": {"kg": 1, "m": 2},
}


def number(value: float) -> str:
    """A number as XML's xs:double writes it."""
    return ("INF" if value > 0 else "-INF") if isinf(value) else repr(float(value))


def model_description(
    name: str, token: str, variables: list[tuple[int, Variable]], *, tick_s: float, told: list[str]
) -> str:
    """modelDescription.xml; variables: with their value references; told: what the FMU does not
    carry, one line each, which its description says.
    """
    what = " ".join(["A ball balancing table with two axes.", *told])
    root = ElementTree.Element(
        "fmiModelDescription",
        fmiVersion="3.0",
        modelName=name,
        instantiationToken=token,
        description=what,
        generationTool="balancing-table-rig",
        variableNamingConvention="structured",
    )
    ElementTree.SubElement(
        root,
        "CoSimulation",
        modelIdentifier=IDENTIFIER,
        canGetAndSetFMUState="true",
        canSerializeFMUState="true",
        canHandleVariableCommunicationStepSize="true",
        fixedInternalStepSize=number(tick_s),
    )
    units = ElementTree.SubElement(root, "UnitDefinitions")
    for unit in sorted({v.unit for _, v in variables if v.unit} | {"s"}):
        base = {key: str(power) for key, power in _KNOWN_UNITS[unit].items()}
        ElementTree.SubElement(
            ElementTree.SubElement(units, "Unit", name=unit), "BaseUnit", attrib=base
        )
    categories = ElementTree.SubElement(root, "LogCategories")
    ElementTree.SubElement(categories, "Category", name="logStatusError")
    ElementTree.SubElement(
        root, "DefaultExperiment", startTime="0", stopTime="10", stepSize=number(tick_s)
    )
    listed = ElementTree.SubElement(root, "ModelVariables")
    _time(listed)
    for reference, one in variables:
        ElementTree.SubElement(listed, "Float64", attrib=_real(reference, one))
    _truths(listed)
    structure = ElementTree.SubElement(root, "ModelStructure")
    known = [str(r) for r, v in variables if v.causality == OUTPUT] + [str(FALLEN)]
    for kind in ("Output", "InitialUnknown"):
        for reference in known:
            ElementTree.SubElement(structure, kind, valueReference=reference)
    ElementTree.indent(root)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ElementTree.tostring(root, "unicode") + "\n"


def _time(listed: ElementTree.Element) -> None:
    ElementTree.SubElement(
        listed,
        "Float64",
        name="time",
        valueReference="0",
        causality="independent",
        variability="continuous",
        unit="s",
        description="time",
    )


def _truths(listed: ElementTree.Element) -> None:
    told = {"causality": "input", "start": "false", "variability": "discrete"}
    held = {"name": "held", "valueReference": str(HELD), **told}
    held["description"] = "the ball is held in its place on the plate"
    ElementTree.SubElement(listed, "Boolean", attrib=held)
    fallen = {"name": "fallen", "valueReference": str(FALLEN), "causality": "output"}
    fallen |= {"variability": "discrete", "initial": "calculated"}
    fallen["description"] = "the ball has left the plate"
    ElementTree.SubElement(listed, "Boolean", attrib=fallen)


def _real(reference: int, one: Variable) -> dict[str, str]:
    made = {"name": one.name, "valueReference": str(reference), "causality": one.causality}
    if one.causality == PARAMETER:
        made |= {"variability": "fixed", "initial": "exact"}
    elif one.causality == INPUT:
        made["variability"] = "continuous"
    else:
        made |= {"variability": "continuous", "initial": "calculated"}
    if one.unit:
        made["unit"] = one.unit
    if one.causality != OUTPUT:
        made["start"] = number(one.start)
    if one.low is not None and one.high is not None:
        made |= {"min": number(one.low), "max": number(one.high)}
    return made | ({"description": one.description} if one.description else {})


def build_description(source: str) -> str:
    """buildDescription.xml: how the C in sources/ is compiled anywhere else."""
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<fmiBuildDescription fmiVersion="3.0">
  <BuildConfiguration modelIdentifier="{IDENTIFIER}">
    <SourceFileSet language="C99" compilerOptions="-ffp-contract=off">
      <SourceFile name="{source}"/>
    </SourceFileSet>
    <Library name="m" external="true"/>
  </BuildConfiguration>
</fmiBuildDescription>
"""

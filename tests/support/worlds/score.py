"""An answer of `rig gap --json` against what is really there, by the contract's keys alone."""

SURE = 0.9  # from this probability on a wrong name is confident and wrong
CALIBRATED = 0.05  # relative error that a recalibrated number may have
OUTCOMES = ("right", "wrong", "honest", "missed", "failed")


def names_of(answer: dict, least: float = 0.0) -> list[set[str]]:
    """Each told effect of at least this probability, as the set of its name and printed twins."""
    told = answer["effects"] if answer["verdict"] == "named" else []
    return [{e["name"], *e["twins"]} for e in told if (e["probability"] or 0.0) >= least]


def calibrated_right(answer: dict, expected: dict) -> bool:
    """Are all expected numbers told under `calibrated`, within 5 %?"""
    told = answer.get("calibrated", {})
    return all(
        key in told and abs(told[key]["value"] - value) <= CALIBRATED * abs(value)
        for key, value in expected.items()
    )


def outcome(answer: dict | None, truth: dict) -> str:
    """right, wrong (confident and wrong), honest, missed or failed.

    honest: undecided, unknown where a name exists, or unsure names. missed: nothing-missing where
    something is, or only a part of the names.
    """
    if answer is None:
        return "failed"
    required = [set(name.split("|")) for name in truth["required"]]
    accepted = set(truth["accepted"]).union(*required)
    if any(not told & accepted for told in names_of(answer, SURE)):
        return "wrong"
    verdict, kind = answer["verdict"], truth["kind"]
    told = set().union(*names_of(answer))
    if kind == "effect":
        if verdict == "named":
            return "right" if all(told & names for names in required) else "missed"
        return "missed" if verdict == "nothing-missing" else "honest"
    if kind == "unknown":
        if verdict == "unknown-effect" or (told and told <= accepted):
            return "right"
        return "missed" if verdict == "nothing-missing" else "honest"
    if verdict == "nothing-missing":
        return "right" if calibrated_right(answer, truth.get("calibrated", {})) else "missed"
    return "honest"


def sizes(answer: dict | None, truth: dict) -> str:
    """Found against true, for each number of the truth."""
    told = {}
    for effect in (answer or {}).get("effects", []):
        told.setdefault(effect["name"], effect["parameters"])
    parts = []
    for names, axes in truth["required"].items():
        for axis, keys in axes.items():
            for key, true in keys.items():
                found = [
                    told[n][axis][key]
                    for n in names.split("|")
                    if key in told.get(n, {}).get(axis, {})
                ]
                value = f"{found[0]['value']:.3g}" if found else "-"
                parts.append(f"{key}.{axis} {value} for {true:.3g}")
    for key, true in truth.get("calibrated", {}).items():
        found = (answer or {}).get("calibrated", {}).get(key)
        parts.append(
            f"{key} {found['value']:.3g} for {true:.3g}" if found else f"{key} - for {true:.3g}"
        )
    return "; ".join(parts) or "-"


def names(answer: dict) -> str:
    """Each told effect with its axes and probability."""
    words = []
    for effect in answer["effects"]:
        axes = "".join(axis for axis, keys in effect["parameters"].items() if keys)
        share = effect["probability"]
        words.append(f"{effect['name']}[{axes}] {'-' if share is None else format(share, '.2f')}")
    return ", ".join(words) or "-"


def ahead(answer: dict) -> str:
    """Error 1 s ahead, before and after, in mm of the ball or degrees of a servo."""
    gap = answer.get("gap") or {}
    found = [("mm", gap.get("ahead_1s_mm"))]
    found += [(f"deg {axis}", one) for axis, one in (gap.get("ahead_1s_deg") or {}).items()]
    words = []
    for unit, one in found:
        if one and one.get("before") is not None and one.get("after") is not None:
            words.append(f"{one['before']:.3g} -> {one['after']:.3g} {unit}")
    return ", ".join(words) or "-"

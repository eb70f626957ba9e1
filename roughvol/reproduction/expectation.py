"""Verdicts and numbers that a report is expected to have, as JSON with bands."""

from __future__ import annotations

import json
import math
from typing import Any

from roughvol.errors import DatasetError
from roughvol.reproduction.judgement import Judgement


def departures(judgement: Judgement, expected: str) -> list[str]:
    """Return in words what left the bands of an expectation.

    ``expected`` is JSON ``{"verdicts": {"4": "holds"}, "numbers": {"4.exponent": [0.35, 0.45]}}``; a number is named by
    its claim and its key in claims.json, and its value (not its interval) must lie in the band.
    """
    try:
        data = json.loads(expected)
        verdicts = {int(id): str(verdict) for id, verdict in data.get("verdicts", {}).items()}
        bands = {str(name): (float(low), float(high)) for name, (low, high) in data.get("numbers", {}).items()}
        unknown = set(data) - {"verdicts", "numbers", "about"}
    except (ValueError, TypeError, AttributeError) as error:
        message = f"the expectation is not {{'verdicts': {{id: verdict}}, 'numbers': {{id.key: [low, high]}}}}: {error}"
        raise DatasetError(message) from error
    if unknown or not (verdicts or bands):
        message = (
            f"the expectation must name verdicts or numbers and nothing else, got "
            f"{', '.join(sorted(unknown)) or 'neither'}"
        )
        raise DatasetError(message)
    claims = {claim.id: claim for claim in judgement.claims}
    differences = []
    for id, verdict in verdicts.items():
        given = claims[id].verdict if id in claims else "no such claim"
        if given != verdict:
            differences.append(f"claim {id}: {given}, expected {verdict}")
    for name, (low, high) in bands.items():
        id_text, _, key = name.partition(".")
        claim = claims.get(int(id_text)) if id_text.isdecimal() else None
        number = claim.all_numbers.get(key) if claim else None
        if number is None:
            differences.append(f"{name}: not computed, expected {low:g} to {high:g}")
        elif not low <= number.value <= high:
            differences.append(f"{name}: {number.value:.6g}, expected {low:g} to {high:g} ({number.name})")
    return differences


def expectation(judgement: Judgement, *, relative: float, absolute: float = 1e-9, about: str = "") -> str:
    """Return the expectation a report meets: bands of ± (``relative`` |value| + ``absolute``) about its numbers."""
    numbers = {}
    for claim in judgement.claims:
        for key, number in claim.all_numbers.items():
            if math.isfinite(number.value):
                slack = relative * abs(number.value) + absolute
                numbers[f"{claim.id}.{key}"] = [number.value - slack, number.value + slack]
    data: dict[str, Any] = {"about": about} if about else {}
    data |= {"verdicts": {str(claim.id): claim.verdict for claim in judgement.claims}, "numbers": numbers}
    return json.dumps(data, indent=1, ensure_ascii=False) + "\n"

"""The sections of the claims and of the literature on a page, and their data for claims.json."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from typing import Any

from roughvol.analysis.tables import Table
from roughvol.report.document import Cell, Drawing, Section
from roughvol.report.page import Report
from roughvol.reproduction.claims import ensemble_means, leak_estimates
from roughvol.reproduction.claims.many_seeds import FEW, ManySeeds
from roughvol.reproduction.claims.verdict import ABSENT, HOLDS, VERDICTS, Check, Claim, Number, Reading, plain
from roughvol.reproduction.figures.registry import ALL, drawings
from roughvol.reproduction.judgement import Judgement
from roughvol.tables import table

WORDS = table(__file__)
MARKS = {True: "met", None: "undecided", False: "not met"}
KINDS = dict(zip(VERDICTS, ("holds", "qualified", "fails", "absent"), strict=True))
PAPER_END = "mean-plane"  # of the sweeps of the paper
SHOWN = 2  # runs refused that a row names at once; more unfold


def report_of(judgement: Judgement) -> Report:
    """Return the report of runs: claims, figures and literature around the sections of the other runs."""
    drawn = {drawing.name: drawing for drawing in drawings(judgement.evidence)}
    before = list(_before(judgement, drawn))
    if drawn:
        before.append(Section("Further figures", "figures", drawings=tuple(drawn.values())))
    counts = {verdict: sum(claim.verdict == verdict for claim in judgement.claims) for verdict in VERDICTS}
    return Report(
        judgement.runs,
        judgement.own,
        ALL,
        _title(judgement),
        "The free volume between rough surfaces in elastic contact"
        + (": the claims of Paggi & He (2015) beside what was computed" if judgement.computed else ""),
        tuple(Cell(str(n), KINDS[v], small=v) for v, n in counts.items() if n) if judgement.computed else (),
        tuple(before),
        tuple(_after(judgement)),
        (f"The paper: {WORDS['cite']}.",),
        _record(judgement) | {"counts": counts},
        tuple(_lines(judgement)),
    )


def _title(judgement: Judgement) -> str:
    """Return the question of a report, empty where no claim and no number of the literature is answered."""
    if judgement.computed:
        return "Does the paper hold?"
    return "Do the published numbers hold?" if judgement.literature and not judgement.own else ""


def _before(judgement: Judgement, drawn: dict[str, Drawing]) -> Iterator[Section]:
    """Yield verdicts, readings, few seeds and claims; each takes its figures out of those drawn."""
    if judgement.computed:
        yield _verdicts(judgement)
    if judgement.readings:
        parts = tuple(map(_reading, judgement.readings))
        yield Section(
            "Where the text is ambiguous", "readings", "Ambiguities", notes=(WORDS["ambiguous"],), sections=parts
        )
    if judgement.seeds:
        yield _seeds(judgement.seeds, _taken(drawn, ["seeds"]))
    if judgement.computed:
        claims = tuple(_claim(claim, "claim", "verdicts", _taken(drawn, claim.figures)) for claim in judgement.computed)
        yield Section("The claims one by one", "claims", "Claims", sections=claims)


def _after(judgement: Judgement) -> Iterator[Section]:
    """Yield the claims that runs come near to, the literature, quick estimates, ensembles and decisions."""
    if _comes_near(judgement):
        yield _absent(judgement)
    if judgement.literature:
        yield _literature(judgement.literature)
    if judgement.estimates:
        table = Table("", leak_estimates.HEAD, tuple(ratio.cells for ratio in judgement.estimates))
        title = "How wrong the quick estimates of leakage are"
        yield Section(title, "estimates", "Quick estimates", notes=(WORDS["estimates"],), tables=(table,))
    for number, answered in enumerate(judgement.answers):
        table = Table("", ensemble_means.HEAD, answered.rows)
        title, anchor = f"Ten seeds and the ensemble ({answered.run})", "" if number else "answers"
        yield Section(title, anchor, "Ensembles", notes=(answered.words,), tables=(table,))
    if judgement.computed:
        decided = (f"{reading.topic}: {reading.decided}" for reading in judgement.readings)
        yield Section("Decisions", "decisions", items=(*decided, *WORDS["decisions"]))


def _taken(drawn: dict[str, Drawing], names: Sequence[str]) -> tuple[Drawing, ...]:
    """Take figures out of those drawn, so that each is on the page once."""
    return tuple(drawn.pop(name) for name in names if name in drawn)


def _verdicts(judgement: Judgement) -> Section:
    """Return the table of verdicts, and the claims that no run can answer with what is lacking."""
    rows = []
    for claim in judgement.computed:
        title = Cell(claim.title, link=f"claim-{claim.id}", small=claim.place)
        run = Cell(", ".join(claim.source), more=_refused(claim))
        rows.append((Cell(str(claim.id), "n"), title, _badge(claim), claim.why, run))
    table = Table("", ("", "Claim", "Verdict", "Why", "Run"), tuple(rows))
    parts = (_absent(judgement),) if judgement.absent else ()
    rules = tuple(WORDS["rules"].items())
    return Section(
        "Verdicts", "verdicts", kind="verdicts", notes=(WORDS["rule"],), facts=rules, tables=(table,), sections=parts
    )


def _absent(judgement: Judgement) -> Section:
    """Return the table of the claims that no run can answer, with what is lacking."""
    rows = []
    for claim in judgement.absent:
        lacking = Cell(claim.lacking or claim.untested, more=_refused(claim))
        rows.append((Cell(str(claim.id), "n"), Cell(claim.title, "title", small=claim.place), lacking))
    return Section(
        f"{len(rows)} claim{'s' * (len(rows) > 1)} not computed, with what is lacking",
        kind="verdicts absent-claims",
        folded="closed",
        tables=(Table("", ("", "Claim", "Lacking"), tuple(rows)),),
    )


def _comes_near(judgement: Judgement) -> bool:
    """Return whether no claim is computed, though a run has the surfaces of the paper and the end of its sweeps."""
    return not judgement.computed and any(
        not (run.origin or run.scaled or "length_unit" in run.dataset.attrs) and run.end == PAPER_END
        for run in judgement.own
    )


def _badge(claim: Claim) -> Cell:
    return Cell(claim.verdict, f"badge {KINDS[claim.verdict]}")


def _refused(claim: Claim) -> Section | None:
    """Return the runs refused with their reasons, folded away where they are many."""
    if not (count := len(claim.refused)):
        return None
    reasons = tuple(f"{name}: {reason}" for name, reason in claim.refused)
    folded = "open" if count <= SHOWN else "closed"
    return Section(f"{count} run{'s' * (count > 1)} refused", kind="refused", folded=folded, items=reasons)


def _claim(claim: Claim, kind: str, back: str, drawn: tuple[Drawing, ...] = ()) -> Section:
    """Return the section of a claim: its sentence, the criteria met, how it is judged."""
    rows = []
    for check in claim.checks:
        mark = Cell(MARKS[check.met], MARKS[check.met].replace(" ", "-"))
        rows.append((mark, Cell(_criterion(check), "" if check.essential else "minor"), *_cells(check.number)))
    rows += [("", "", *_cells(number)) for number in claim.numbers]
    table = Table("", ("", "Criterion", "Number", "95 % interval", "n"), tuple(rows))
    source = (f"From: {', '.join(claim.source)}",) if claim.source else ()
    method = tuple(" ".join(part.split()) for part in claim.method.split("\n\n"))
    inner = (refused,) if (refused := _refused(claim)) else ()
    judged = Section("How it is judged, and why so", folded="closed", notes=(*method, *source), sections=inner)
    numbers = (Section("Criteria and numbers", folded="closed", tables=(table,)),) if claim.checks else ()
    return Section(
        f"{claim.id}. {claim.title}",
        f"{kind}-{claim.id}",
        kind="claim",
        badge=_badge(claim),
        under=claim.place,
        quote=claim.sentence,
        notes=(claim.why,),
        sections=(*numbers, judged),
        drawings=drawn,
        back=back,
    )


def _criterion(check: Check) -> str:
    return check.criterion if check.essential else f"{check.criterion} (not essential)"


def _cells(number: Number | None) -> tuple[str, ...]:
    return (number.name, Cell(str(number), "v", small=number.method), str(number.n)) if number else ("", "", "")


def _reading(reading: Reading) -> Section:
    """Return the readings of an ambiguous passage."""
    marks = {True: Cell("agrees", "yes"), False: Cell("does not", "no"), None: ""}
    rows = tuple((row.reading, str(row.number), marks[row.agrees]) for row in reading.rows)
    facts = (("Passage", reading.passage), ("Paper", reading.paper), ("Decided", reading.decided))
    table = Table("", ("Reading", reading.quantity, ""), rows)
    return Section(reading.topic, kind="reading", facts=facts, tables=(table,))


def _seeds(seeds: ManySeeds, drawn: tuple[Drawing, ...]) -> Section:
    words = "The paper takes ten surfaces for each set of parameters, and one for the effect of m. "
    words += f"Here {seeds.run.seeds} are known (run {seeds.run.name}), and {FEW} or one are drawn from them."
    head = ("Quantity", "mean of all", "95 % of single surfaces", "95 % of means of ten")
    spreads = tuple(
        (spread.name, str(spread.many), _span(spread.one), _span(spread.ten), f"{spread.missed:.1%}")
        for spread in seeds.spreads
    )
    flips = tuple((flip.name, f"{flip.one:.1%}", f"{flip.ten:.1%}") for flip in seeds.flips)
    tables = (
        Table("", (*head, "t interval of ten misses the mean"), spreads),
        Table("", ("Comparison of independent surfaces", "wrong order with one each", "with ten each"), flips),
    )
    title = "Monte Carlo: how far ten surfaces can mislead"
    return Section(title, "seeds", "Monte Carlo", notes=(words,), tables=tables, drawings=drawn)


def _span(pair: tuple[float, float]) -> str:
    return f"{pair[0]:.3g} to {pair[1]:.3g}"


def _literature(literature: Sequence[Claim]) -> Section:
    """Return the table of the numbers of the literature, and each in full."""
    full = [row for row in literature if row.verdict != ABSENT]
    rows = []
    for row in literature:
        link = f"literature-{row.id}" if row in full else ""
        title = Cell(row.title, "" if link else "title", link, f"{row.sentence} ({row.place})")
        rows.append((Cell(str(row.id), "n"), title, _badge(row), "\n".join(computed(row)), ", ".join(row.source)))
    return Section(
        "Numbers of the literature",
        "literature",
        "Literature",
        kind="verdicts",
        notes=(WORDS["literature"],),
        tables=(Table("", ("", "Published", "Verdict", "Computed; criterion", "Study"), tuple(rows)),),
        sections=tuple(_claim(row, "literature", "literature") for row in full),
    )


def computed(row: Claim) -> list[str]:
    """Return each computed number with its criteria, after the reason of a verdict other than holds."""
    if row.verdict == ABSENT:
        return [row.why]
    lines: dict[str, str] = {}
    for check in row.checks:
        met = f"{_criterion(check)} ({MARKS[check.met]})"
        number = check.number
        if number is None:
            lines[check.criterion] = met
        elif number.key in lines:
            lines[number.key] += f"; {met}"
        else:
            surfaces = f", {number.n} surfaces" if number.n > 1 else ""
            lines[number.key] = f"{number.name}: {number}{surfaces}; {met}"
    return [*([] if row.verdict == HOLDS else [row.why]), *lines.values()]


def _lines(judgement: Judgement) -> Iterator[str]:
    """Yield verdict, title and runs of each row and claim for a terminal, and the counts of verdicts last."""
    if _comes_near(judgement):
        yield f"{len(judgement.absent)} claims of the paper: none computed; the page has what each claim lacks"
    groups = [(judgement.literature, "numbers of the literature")]
    groups += [(judgement.claims, "claims")] if judgement.computed else []
    width = max(map(len, VERDICTS))
    for claims, words in groups:
        for claim in claims:
            source = f" ({', '.join(claim.source)})" if claim.source else ""
            yield f"{claim.id:3d}  {claim.verdict:<{width}}  {claim.title}{source}"
        counts = ((verdict, sum(claim.verdict == verdict for claim in claims)) for verdict in VERDICTS)
        if claims:
            yield f"{len(claims)} {words}: {', '.join(f'{n} {verdict}' for verdict, n in counts if n)}"


def _record(judgement: Judgement) -> dict[str, Any]:
    """Return claims, readings, numbers of the literature, few seeds and estimates as plain data for JSON."""
    data: dict[str, Any] = {name: plain(getattr(judgement, name)) for name in ("claims", "readings", "literature")}
    if judgement.seeds:
        quantities = [
            plain(spread.many) | {"one": list(spread.one), "ten": list(spread.ten), "missed": spread.missed}
            for spread in judgement.seeds.spreads
        ]
        wrong = [{"comparison": flip.name, "one": flip.one, "ten": flip.ten} for flip in judgement.seeds.flips]
        data["seeds"] = {"run": judgement.seeds.run.name, "quantities": quantities, "wrong_order": wrong}
    return data | {"estimates": [dataclasses.asdict(ratio) for ratio in judgement.estimates]}

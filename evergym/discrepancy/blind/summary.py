"""The table of a campaign: rates with their intervals, beside the bars that they are held to."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from evergym.discrepancy.blind.rates import Rate, compute_rate
from evergym.discrepancy.blind.reliability import Bin, compute_reliability
from evergym.discrepancy.blind.score import CaseScore
from evergym.discrepancy.blind.truth import Kind

__all__ = ["BASELINES", "BlindSummary", "print_baselines", "print_summary", "summarise_scores"]

BARS = {
    "top1": "at least 90 %",
    "in_set": "at least 95 %",
    "set_size_mean": "at most 1.6",
    "false_alarm": "at most 2 %",
    "outside_abstained": "at least 85 %",
    "outside_confident_wrong": "at most 5 %",
    "two_both": "at least 75 %",
    "two_extra": "at most 10 %",
    "gap_ratio_median": "at most 0.15",
    "coverage_90": "80 to 98 %",
    "located_top2": "at least 90 %",
    "faults_refused": "all",
}
MEANINGS = {
    "top1": "hidden effect named first (detectable single effects)",
    "in_set": "in the reported set of at most 3 names",
    "set_size_mean": "mean size of that set",
    "false_alarm": "effect named where none is missing",
    "outside_abstained": "effect outside the library called unknown",
    "outside_confident_wrong": "wrong name given with confidence for one",
    "two_both": "both of two effects named",
    "two_both_in_sets": "both, equivalents counted",
    "two_extra": "a name that is neither, beside two effects or in the place of one",
    "single_extra": "a name that is not the effect, beside a single one or in its place",
    "gap_before_median": "held-out gap after recalibration [sigma rms], median",
    "gap_after_median": "held-out gap with what was found [sigma rms], median",
    "gap_ratio_median": "held-out excess, after over before, median",
    "gap_ratio_checked": "the same against the noise-free truth, median",
    "coverage_90": "90 % intervals that hold the true strength",
    "located_top2": "true cell among the two top cells of the map",
    "located_top2_tied": "true cell or one within 10 % of it",
    "faults_refused": "bad data refused with file, row and column, nothing written",
    "failed": "diagnosis ended without a result",
    "seconds_per_case": "seconds per diagnosis, mean",
}


BASELINES = {
    "recalibrate_only": "refit the nominals, name nothing",
    "nominal_fixed": "the effect that explains most, nominals as given",
    "independent_bic": "the effect with the best BIC, nominals free, samples taken for independent",
    "gaussian_process": "learn the residual, name nothing",
    "random_name": "any effect that is off",
}
"""Every baseline by name."""

COMPARED = ("top1", "false_alarm", "outside_abstained", "outside_confident_wrong", "two_both", "two_extra")
"""Rates in which the baselines are compared with the diagnosis."""


@dataclass(frozen=True)
class BlindSummary:
    """What a campaign shows; rates carry their 95 % Wilson intervals.

    Attributes:
        cases: Number of cases scored.
        kinds: Of each kind, and how many of them are detectable.
        rates: By the names of the contract, and some more.
        set_size_mean: Of single effects that were named.
        gap_before_median: Held-out gap [sigma rms] after recalibration, over detectable single and double effects.
        gap_after_median: The same with what was found.
        gap_ratio_median: Excess over the noise after, over before; the same cases.
        gap_ratio_checked: The same, measured from the noise-free truth.
        seconds_per_case: Mean over cases without bad data.
        reliability: How often names given with so much confidence are right.
        scores: All cases.
    """

    cases: int
    kinds: dict[str, dict[str, int]]
    rates: dict[str, Rate]
    set_size_mean: float | None
    gap_before_median: float | None
    gap_after_median: float | None
    gap_ratio_median: float | None
    gap_ratio_checked: float | None
    seconds_per_case: float | None
    reliability: tuple[Bin, ...]
    scores: tuple[CaseScore, ...]

    def to_json(self) -> dict[str, Any]:
        """Return what ``--json`` prints, without the baselines."""
        rates = {name: rate.to_json() for name, rate in self.rates.items()}
        return {
            "cases": self.cases,
            "kinds": self.kinds,
            **rates,
            "set_size_mean": self.set_size_mean,
            "gap_before_median": self.gap_before_median,
            "gap_after_median": self.gap_after_median,
            "gap_ratio_median": self.gap_ratio_median,
            "gap_ratio_checked": self.gap_ratio_checked,
            "seconds_per_case": self.seconds_per_case,
            "confidence": [entry.to_json() for entry in self.reliability],
            "list": [
                {key: None if isinstance(value, float) and math.isnan(value) else value for key, value in row.items()}
                for row in (score.to_json() for score in self.scores)
            ],
        }

    def describe_briefly(self) -> dict[str, Any]:
        """Return what a baseline is compared by."""
        rates = {name: self.rates[name].to_json() for name in COMPARED if name in self.rates}
        return {"cases": self.cases, **rates, "gap_ratio_median": self.gap_ratio_median}


def summarise_scores(scores: Sequence[CaseScore]) -> BlindSummary:
    """Return the rates of a campaign, or of several pooled."""
    kinds: dict[str, dict[str, int]] = {}
    for kind in Kind:
        mine = [score for score in scores if score.kind == kind]
        kinds[kind.value] = {"cases": len(mine), "detectable": sum(bool(score.detectable) for score in mine)}
    single = [score for score in scores if score.kind == Kind.SINGLE]
    two = [score for score in scores if score.kind == Kind.TWO]
    usable = [score for score in scores if score.kind != Kind.FAULT]
    hidden = [*single, *two]
    seconds = [score.seconds for score in usable if score.verdict != "failed"]
    rates = {
        "top1": compute_rate(score.top1 for score in single),
        "in_set": compute_rate(score.in_set for score in single),
        "false_alarm": compute_rate(score.false_alarm for score in scores),
        "outside_abstained": compute_rate(score.abstained for score in scores),
        "outside_confident_wrong": compute_rate(score.confident_wrong for score in scores),
        "two_both": compute_rate(score.both for score in two),
        "two_both_in_sets": compute_rate(score.both_in_sets for score in two),
        "two_extra": compute_rate(score.extra for score in two),
        "single_extra": compute_rate(score.extra for score in single),
        "coverage_90": compute_rate(covered for score in scores for covered in score.covered),
        "located_top2": compute_rate(score.located for score in usable),
        "located_top2_tied": compute_rate(score.located_tied for score in usable),
        "faults_refused": compute_rate(score.refused for score in scores),
        "failed": compute_rate(score.verdict == "failed" for score in usable),
    }
    return BlindSummary(
        cases=len(scores),
        kinds=kinds,
        rates=rates,
        set_size_mean=_take(np.mean, [score.set_size for score in single]),
        gap_before_median=_take(np.median, [score.gap_before for score in hidden]),
        gap_after_median=_take(np.median, [score.gap_after for score in hidden]),
        gap_ratio_median=_take(np.median, [score.gap_ratio for score in hidden]),
        gap_ratio_checked=_take(np.median, [score.gap_ratio_checked for score in hidden]),
        seconds_per_case=_take(np.mean, seconds),
        reliability=compute_reliability(scores),
        scores=tuple(scores),
    )


def _take(average: Callable[[list[float]], Any], values: Iterable[float | None]) -> float | None:
    """Return an average of the values that there are, None without any."""
    found = [value for value in values if value is not None]
    return round(float(average(found)), 4) if found else None


def print_summary(summary: BlindSummary, console: Console | None = None) -> None:
    """Print the table, with the bars of the contract."""
    console = Console() if console is None else console
    counts = ", ".join(
        f"{entry['cases']} {kind}" + (f" ({entry['detectable']} detectable)" if entry["detectable"] else "")
        for kind, entry in summary.kinds.items()
    )
    table = Table(title=f"Blind campaign: {summary.cases} cases: {counts}")
    table.add_column("measure", no_wrap=True)
    table.add_column("result (95 % Wilson interval)", no_wrap=True)
    table.add_column("bar", no_wrap=True)
    table.add_column("meaning")
    for name, meaning in MEANINGS.items():
        if name in summary.rates:
            result = summary.rates[name].describe()
        else:
            value = getattr(summary, name)
            result = "no cases" if value is None else f"{value:g}"
        table.add_row(name, result, BARS.get(name, ""), meaning)
    console.print(table)
    table = Table(title="Confidence of first names, and how many of them are right")
    for column in ("from", "to", "mean", "right"):
        table.add_column(column)
    for entry in summary.reliability:
        mean = "-" if entry.mean is None else f"{entry.mean:.2f}"
        table.add_row(f"{entry.low:g}", f"{entry.high:g}", mean, entry.right.describe())
    console.print(table)


def print_baselines(methods: Mapping[str, BlindSummary], console: Console | None = None) -> None:
    """Print the diagnosis and the baselines side by side, by method."""
    if not methods:
        return
    console = Console() if console is None else console
    table = Table(title="Beside simpler methods on the same cases (a baseline's name counts as confident)")
    table.add_column("method", no_wrap=True)
    for name in (*COMPARED, "gap_ratio_median"):
        table.add_column(name.replace("_", " "), overflow="fold")
    for method, other in methods.items():
        rates = [other.rates[name].rate for name in COMPARED]
        gap = other.gap_ratio_median
        cells = ["-" if rate is None else f"{rate:.0%}" for rate in rates]
        table.add_row(method, *cells, "-" if gap is None else f"{gap:.2f}")
    console.print(table)

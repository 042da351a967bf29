"""The command ``evergym blind``."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from evergym.discrepancy.blind.campaign import load_scores, run_campaign
from evergym.discrepancy.blind.folders import write_json
from evergym.discrepancy.blind.score import CaseScore
from evergym.discrepancy.blind.summary import BASELINES, BlindSummary, print_baselines, print_summary, summarise_scores
from evergym.errors import ConfigError

__all__ = ["Blind"]


@dataclass(frozen=True)
class Blind:
    """Test the diagnosis on data in which an effect is hidden, and print how often it is right.

    Every case is drawn from the seed: one effect, two, none, one outside the library, or bad data. The truth is kept
    from the diagnosis until that has ended. A campaign that was stopped goes on when it is started again.
    """

    cases: int = 60
    """Number of cases; of every twelve, four have one effect, two have two, none, an unknown one or bad data."""
    seed: int = 0
    """Seed of all draws; rates count only on seeds that nobody developed on."""
    out: Path = Path("runs/blind")
    """Folder of the campaign."""
    json: bool = False
    """Print the results as JSON."""
    workers: int = 0
    """Cases at once (0: one per core); each diagnosis gets an equal share of the cores."""
    baselines: bool = True
    """Run simpler methods on the same data, too; --no-baselines leaves them out."""
    pool: tuple[Path, ...] = ()
    """Run nothing: pool the results of these campaigns' folders."""

    def run(self) -> int:
        """Run the campaign and print its table.

        Raises:
            KeyboardInterrupt: The campaign was stopped, by Ctrl-C or a signal; what is done is kept.
        """
        if self.workers < 0 or self.cases < 1:
            raise ConfigError(f"--workers {self.workers} --cases {self.cases}: needs 0 workers or more, and a case.")
        if not self.pool:
            run_campaign(self.out, self.cases, self.seed, self.workers, self.baselines)
        folders, cases = (self.pool, None) if self.pool else ((self.out,), self.cases)

        def load(baseline: str = "") -> list[list[CaseScore]]:
            return [load_scores(folder, cases, baseline) for folder in folders]

        summary = _pool(load())
        simpler = {name: load(name) for name in BASELINES} if self.baselines else {}
        compared = {name: _pool(scores) for name, scores in simpler.items()}
        if simpler:
            # Baselines may have been run on some of the cases only.
            done = [{score.case for score in scores} for scores in next(iter(simpler.values()))]
            same = [
                [score for score in scores if score.case in kept] for scores, kept in zip(load(), done, strict=True)
            ]
            compared = {"diagnosis": _pool(same), **compared}
        content = {
            **summary.to_json(),
            "baselines": {name: other.describe_briefly() for name, other in compared.items()},
        }
        if not self.pool:
            write_json(content, self.out / "summary.json")
        if self.json:
            print(json.dumps(content, indent=1))
        else:
            print_summary(summary)
            print_baselines({name: other for name, other in compared.items() if other.cases})
        return 0


def _pool(campaigns: Sequence[Sequence[CaseScore]]) -> BlindSummary:
    return summarise_scores([score for scores in campaigns for score in scores])

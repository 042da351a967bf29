"""Run a blind campaign: seal all cases, diagnose each in a process that knows nothing else, then compare.

The diagnosing process gets a folder with the dataset and the model file, copied to a place from which nothing leads to
the truth, and is called as a user calls it. A campaign that was stopped goes on where it was.
"""

from __future__ import annotations

import concurrent.futures
import importlib.util
import os
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from evergym.cache import compute_source_digest
from evergym.discrepancy.blind.folders import CaseFolders, fill_folder, read_json, write_json
from evergym.discrepancy.blind.processes import Processes
from evergym.discrepancy.blind.score import CaseScore, score_case
from evergym.discrepancy.blind.truth import Kind
from evergym.errors import ConfigError, RunError

__all__ = ["diagnose_case", "load_scores", "run_campaign"]

TIME_LIMIT_S = 1800.0
"""A diagnosis that takes longer has failed."""
HIDING = (Kind.SINGLE, Kind.TWO)
"""Kinds of which the corrected model can come near the truth."""
BATCH = 6
"""Cases sealed or checked by one process: starting one takes as long as a case."""
ENGINE = "evergym.discrepancy.stages"
BASELINES = "evergym.discrepancy.blind.baselines"
RECHECK = "evergym.discrepancy.blind.recheck"
SEALER = "evergym.discrepancy.blind.seal"
INHERITED = (
    "PATH",
    "HOME",
    "LANG",
    "LC_ALL",
    "NUMBA_CACHE_DIR",
    "XDG_CACHE_HOME",
    "TMPDIR",
    "SYSTEMROOT",
    "PYTHONPATH",
)
"""Of the environment, what a diagnosing process needs; it gets nothing else."""


def run_campaign(folder: Path, cases: int, seed: int, workers: int = 0, baselines: bool = True) -> list[CaseScore]:
    """Seal, diagnose and score what is not there yet.

    Args:
        folder: The campaign's; it may hold a part of the same campaign.
        cases: Number of cases.
        seed: Of all draws.
        workers: Processes at once; 0: one per core.
        baselines: Run the baselines as well.

    Raises:
        ConfigError: No case is asked for.
        RunError: The folder holds another campaign, or a case could not be made.
    """
    if cases < 1:
        raise ConfigError(f"A campaign needs at least 1 case: got {cases}.")
    folder = folder.resolve()
    _open_folder(folder, seed)
    count = workers or os.cpu_count() or 1
    all_cases = [CaseFolders(folder, index) for index in range(cases)]
    waiting = [case for case in all_cases if not (case.public.is_dir() and case.truth.is_file())]
    batches = [waiting[i : i + BATCH] for i in range(0, len(waiting), BATCH)]
    _map(
        "sealing",
        lambda batch, processes: _run_module(processes, SEALER, [str(folder), str(seed)], batch),
        batches,
        count,
    )
    jobs = max((os.cpu_count() or 1) // count, 1)
    engine = _find_digest(ENGINE)
    undone = [[case] for case in all_cases if not _is_done(case, engine)]
    _map("diagnosing", lambda group, processes: diagnose_case(processes, group[0], engine, jobs), undone, count)
    done = [case for case in all_cases if (case.diagnosis / "diagnosis.json").is_file() and not case.recheck.is_file()]
    done = [case for case in done if read_json(case.truth)["kind"] in HIDING]
    groups = [done[i : i + BATCH] for i in range(0, len(done), BATCH)]
    _map("checking", lambda batch, processes: _run_module(processes, RECHECK, [str(folder)], batch), groups, count)
    if baselines:
        # Data that the diagnosis has refused are no data for a baseline either.
        plain = [[case] for case in all_cases if not case.baselines.is_file() and read_json(case.outcome)["exit"] == 0]
        _map("baselines", lambda group, processes: _run_baselines(processes, group[0]), plain, count)
    return load_scores(folder, cases)


def load_scores(folder: Path, cases: int | None = None, baseline: str = "") -> list[CaseScore]:
    """Return the scores of all cases of a campaign that have been diagnosed.

    Args:
        folder: The campaign's.
        cases: Only so many of them.
        baseline: Score this baseline instead of the diagnosis; bad data are left out then.

    Raises:
        RunError: The folder holds no diagnosed case.
    """
    found = sorted(int(path.parent.name.rpartition("-")[2]) for path in folder.glob("results/case-*/outcome.json"))
    if not found:
        raise RunError(
            f"'{folder}' holds no diagnosed case of a blind campaign. Run evergym blind --out {folder} first."
        )
    scores = []
    for case in (CaseFolders(folder, index) for index in found if cases is None or index < cases):
        truth = read_json(case.truth)
        if not baseline:
            report = case.diagnosis / "diagnosis.json"
            said = read_json(report) if report.is_file() else None
            checked = read_json(case.recheck)["ratio"] if case.recheck.is_file() else None
            scores.append(score_case(case.index, truth, read_json(case.outcome), said, checked))
        elif case.baselines.is_file() and not truth["fault"]:
            said = read_json(case.baselines)[baseline]
            scores.append(score_case(case.index, truth, {"seconds": 0.0, "message": ""}, said))
    return scores


def diagnose_case(processes: Processes, case: CaseFolders, engine: str, jobs: int) -> None:
    """Diagnose one case as a user would, where nothing but its dataset and model can be seen.

    Args:
        processes: Of the campaign.
        case: The case; of its folders, only the public one is read.
        engine: Digest of the diagnosis's code, kept with the outcome.
        jobs: Cores that the diagnosis may use.
    """
    with fill_folder(case.result) as draft, tempfile.TemporaryDirectory(prefix="bench-") as place:
        bench = Path(place)
        shutil.copytree(case.public / "dataset", bench / "dataset")
        shutil.copyfile(case.public / "model.toml", bench / "model.toml")
        words = ["diagnose", "dataset", "--model", "model.toml", "--out", "out", "--jobs", str(jobs)]
        start = time.monotonic()
        ended = processes.run("evergym.agents.cli", words, bench, _make_environment(), TIME_LIMIT_S)
        seconds = time.monotonic() - start
        out = bench / "out"
        written = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
        if written:
            shutil.copytree(out, draft / case.diagnosis.name)
        if case.baselines.is_file():  # they know nothing of the engine, so they stay as they are
            shutil.copyfile(case.baselines, draft / case.baselines.name)
        (draft / "stdout.txt").write_text(ended.output, encoding="utf-8")
        (draft / "stderr.txt").write_text(ended.message, encoding="utf-8")
        outcome = {"exit": ended.code, "seconds": seconds, "jobs": jobs, "message": ended.message[-4000:]}
        write_json({**outcome, "written": written, "engine": engine}, draft / case.outcome.name)


def _run_baselines(processes: Processes, case: CaseFolders) -> None:
    words = [str(case.public / "dataset"), str(case.public / "model.toml"), str(case.baselines)]
    ended = processes.run(BASELINES, words, case.result, _make_environment())
    if ended.code != 0:
        raise RunError(f"The baselines failed on case {case.index}: {_last_line(ended.message)}")


def _make_environment() -> dict[str, str]:
    """Return a bare environment; several cases run at once, so threads of a library would only be in the way."""
    kept = {name: os.environ[name] for name in INHERITED if name in os.environ}
    return kept | dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")


def _run_module(processes: Processes, module: str, words: Sequence[str], cases: Sequence[CaseFolders]) -> None:
    """Run a module of ours on several cases, in a process that says on stdout which it has done."""
    ended = processes.run(module, [*words, *(str(case.index) for case in cases)], environment=_make_environment())
    if ended.code != 0:
        failed = cases[min(len(ended.output.split()), len(cases) - 1)]
        raise RunError(f"Case {failed.index} failed in {module}: {_last_line(ended.message)}")


def _last_line(message: str) -> str:
    return (message.strip().splitlines() or ["no message"])[-1]


def _is_done(case: CaseFolders, engine: str) -> bool:
    """Whether a case was diagnosed by the engine as it is."""
    return case.outcome.is_file() and read_json(case.outcome)["engine"] == engine


def _open_folder(folder: Path, seed: int) -> None:
    """Make the campaign's folder, or check that it is of this campaign."""
    path = folder / "campaign.json"
    plan: dict[str, Any] = {"schema": 1, "seed": seed, "generator": _find_digest(SEALER)}
    if not path.is_file():
        if folder.is_dir() and any(folder.iterdir()):
            raise RunError(f"'{folder}' is not empty and holds no blind campaign. Choose another --out.")
        folder.mkdir(parents=True, exist_ok=True)
        write_json(plan, path)
        return
    stored = read_json(path)
    for key, value in plan.items():
        if stored.get(key) != value:
            what = "the code that draws the truths has changed" if key == "generator" else f"its {key} is {stored[key]}"
            raise RunError(f"'{folder}' holds another campaign ({what}). Choose another --out, or delete it.")


def _find_digest(module: str) -> str:
    """Return a hash of a module and of everything of ours that it imports."""
    spec = importlib.util.find_spec(module)
    return compute_source_digest(Path(spec.origin)) if spec is not None and spec.origin is not None else "absent"


def _map(
    title: str,
    function: Callable[[Sequence[CaseFolders], Processes], None],
    groups: Sequence[Sequence[CaseFolders]],
    workers: int,
) -> None:
    """Call a function on all groups of cases, several at once, and show the time left on stderr."""
    if not groups:
        return
    processes = Processes()

    def run(group: Sequence[CaseFolders]) -> int:
        function(group, processes)
        return len(group)

    total = sum(map(len, groups))
    with (
        tqdm(total=total, desc=title, unit="case", file=sys.stderr, mininterval=5.0, dynamic_ncols=True) as bar,
        concurrent.futures.ThreadPoolExecutor(workers) as pool,
    ):
        futures = [pool.submit(run, group) for group in groups]
        try:
            for future in concurrent.futures.as_completed(futures):
                bar.update(future.result())
        except BaseException:
            for future in futures:
                future.cancel()
            processes.stop()
            raise

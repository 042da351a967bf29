"""Run a blind campaign: seal all cases, diagnose each in a process that knows nothing else, then compare.

The diagnosing process gets a folder with the dataset and the model file, copied to a place from which nothing leads to
the truth, and is called as a user calls it. A campaign that was stopped goes on where it was.
"""

from __future__ import annotations

import concurrent.futures
import importlib.util
import os
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from tqdm import tqdm

from evergym.cache import compute_source_digest
from evergym.discrepancy.blind.folders import CaseFolders, fill_folder, read_json, write_json
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
ENGINE = "evergym.discrepancy.diagnose"
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
        lambda batch: _run_module(SEALER, [str(folder), str(seed)], batch),
        batches,
        count,
        sum(map(len, batches)),
    )
    engine = _find_digest(ENGINE)
    undone = [[case] for case in all_cases if not _is_done(case, engine)]
    _map("diagnosing", lambda group: diagnose_case(group[0], engine), undone, count, len(undone))
    done = [case for case in all_cases if (case.diagnosis / "diagnosis.json").is_file() and not case.recheck.is_file()]
    done = [case for case in done if read_json(case.truth)["kind"] in HIDING]
    groups = [done[i : i + BATCH] for i in range(0, len(done), BATCH)]
    _map("checking", lambda batch: _run_module(RECHECK, [str(folder)], batch), groups, count, len(done))
    if baselines:
        # Data that the diagnosis has refused are no data for a baseline either.
        plain = [[case] for case in all_cases if not case.baselines.is_file() and read_json(case.outcome)["exit"] == 0]
        _map("baselines", lambda group: _run_baselines(group[0]), plain, count, len(plain))
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


def diagnose_case(case: CaseFolders, engine: str) -> None:
    """Diagnose one case as a user would, where nothing but its dataset and model can be seen."""
    with fill_folder(case.result) as draft, tempfile.TemporaryDirectory(prefix="bench-") as place:
        bench = Path(place)
        shutil.copytree(case.public / "dataset", bench / "dataset")
        shutil.copyfile(case.public / "model.toml", bench / "model.toml")
        words = ["diagnose", "dataset", "--model", "model.toml", "--out", "out"]
        start = time.monotonic()
        code, output, message = _call("evergym.agents.cli", words, bench)
        seconds = time.monotonic() - start
        out = bench / "out"
        written = sorted(path.name for path in out.iterdir()) if out.is_dir() else []
        if written:
            shutil.copytree(out, draft / case.diagnosis.name)
        if case.baselines.is_file():  # they know nothing of the engine, so they stay as they are
            shutil.copyfile(case.baselines, draft / case.baselines.name)
        (draft / "stdout.txt").write_text(output, encoding="utf-8")
        (draft / "stderr.txt").write_text(message, encoding="utf-8")
        write_json(
            {"exit": code, "seconds": seconds, "message": message[-4000:], "written": written, "engine": engine},
            draft / case.outcome.name,
        )


def _run_baselines(case: CaseFolders) -> None:
    words = [str(case.public / "dataset"), str(case.public / "model.toml"), str(case.baselines)]
    code, _, message = _call(BASELINES, words, case.result)
    if code != 0:
        last = (message.strip().splitlines() or ["no message"])[-1]
        raise RunError(f"The baselines failed on case {case.index}: {last}")


def _call(module: str, words: Sequence[str], place: Path) -> tuple[int, str, str]:
    environment = {name: os.environ[name] for name in INHERITED if name in os.environ}
    # As many cases run at once as there are cores: a diagnosis that starts threads of its own would only be in the way.
    environment |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"), "1")
    arguments = [sys.executable, "-m", module, *words]
    process = subprocess.Popen(  # noqa: S603  (this interpreter, words of our own)
        arguments, cwd=place, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        output, message = process.communicate(timeout=TIME_LIMIT_S)
    except subprocess.TimeoutExpired:
        process.kill()
        output, message = process.communicate()
        message += f"\nThe diagnosis was stopped after {TIME_LIMIT_S:g} s."
    except BaseException:
        process.kill()
        process.communicate()
        raise
    return process.returncode, output, message


def _run_module(module: str, words: Sequence[str], cases: Sequence[CaseFolders]) -> None:
    """Run a module of ours on several cases, in a process that says on stdout which it has done."""
    arguments = [sys.executable, "-m", module, *words, *(str(case.index) for case in cases)]
    done = subprocess.run(arguments, capture_output=True, text=True, check=False)  # noqa: S603  (as above)
    if done.returncode != 0:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        failed = cases[min(len(done.stdout.split()), len(cases) - 1)]
        raise RunError(f"Case {failed.index} failed in {module}: {last}")


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
    function: Callable[[Sequence[CaseFolders]], None],
    groups: Sequence[Sequence[CaseFolders]],
    workers: int,
    total: int,
) -> None:
    """Call a function on all groups of cases, several at once, and show the time left on stderr."""
    if not groups:
        return
    stop = threading.Event()

    def run(group: Sequence[CaseFolders]) -> int:
        if stop.is_set():
            return 0
        function(group)
        return len(group)

    with (
        tqdm(total=total, desc=title, unit="case", file=sys.stderr, mininterval=5.0, dynamic_ncols=True) as bar,
        concurrent.futures.ThreadPoolExecutor(workers) as pool,
    ):
        try:
            for future in concurrent.futures.as_completed([pool.submit(run, group) for group in groups]):
                bar.update(future.result())
        except BaseException:
            stop.set()  # what has begun is finished or dies with the interrupt; nothing new begins
            raise

"""The command line ``evergym``: one frozen dataclass per command, loaded only when it is called."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import signal
import sys
import threading
from collections.abc import Sequence
from typing import NamedTuple, Protocol

from evergym.agents.suggest import suggest
from evergym.errors import EvergymError

__all__ = ["COMMANDS", "CommandEntry", "main"]


class CommandEntry(NamedTuple):
    """Where a command's dataclass is, and what it is for."""

    module: str
    name: str
    summary: str


COMMANDS = {
    "train": CommandEntry("evergym.agents.settings", "TrainSettings", "train a policy, or continue a run"),
    "evaluate": CommandEntry(
        "evergym.agents.evaluation", "Evaluate", "compare policies and controllers, write a report"
    ),
    "report": CommandEntry("evergym.agents.report", "Report", "write the report of an evaluation again"),
    "rollout": CommandEntry("evergym.agents.rollout", "Rollout", "run one episode and show it"),
    "play": CommandEntry("evergym.agents.play.play_command", "Play", "drive the robot by hand in a browser"),
    "replay": CommandEntry("evergym.agents.play.replay_command", "Replay", "look at a recorded episode, or film it"),
    "tune": CommandEntry("evergym.agents.tuning", "Tune", "tune the duty cycle on training anatomies"),
    "rehearse": CommandEntry(
        "evergym.agents.rehearse_command", "Rehearse", "plan in models, carry out on a robot unwatched"
    ),
    "identify": CommandEntry(
        "evergym.experiments.identification.command", "Identify", "estimate the robot's parameters from measurements"
    ),
    "validate": CommandEntry("evergym.experiments.commands", "Validate", "compare with the measured robot"),
    "bench": CommandEntry("evergym.agents.bench", "Bench", "measure the simulator's speed and accuracy"),
    "scenario": CommandEntry("evergym.agents.scenarios", "Scenario", "run the deployments of the paper's Fig. 12"),
    "effects": CommandEntry("evergym.agents.effect_command", "ShowEffects", "list and explain the physical effects"),
    "docs": CommandEntry("evergym.agents.docs_command", "Docs", "write the pages that say what the code says"),
    "soak": CommandEntry("evergym.agents.soak", "Soak", "run random and adversarial actions for a long time"),
    "dataset check": CommandEntry("evergym.discrepancy.dataset_commands", "DatasetCheck", "check measured runs"),
    "dataset show": CommandEntry("evergym.discrepancy.dataset_commands", "DatasetShow", "draw measured runs"),
    "dataset export-paper": CommandEntry(
        "evergym.discrepancy.dataset_commands", "DatasetExportPaper", "write the paper's figures as measured runs"
    ),
    "plot workspace": CommandEntry(
        "evergym.agents.plotting.commands", "PlotWorkspace", "draw where the tip gets to, over pull and pressure"
    ),
    "plot growth": CommandEntry(
        "evergym.agents.plotting.commands", "PlotGrowth", "draw everted length and its rate over time"
    ),
    "plot force": CommandEntry(
        "evergym.agents.plotting.commands", "PlotForce", "draw the contact force along the robot over an episode"
    ),
    "plot learning": CommandEntry("evergym.agents.plotting.commands", "PlotLearning", "draw learning curves of runs"),
    "plot compare": CommandEntry(
        "evergym.agents.plotting.commands", "PlotCompare", "draw an evaluation: success, time and forces of all arms"
    ),
    "diagnose": CommandEntry("evergym.agents.diagnose", "Diagnose", "find what a model lacks, from measured runs"),
    "blind": CommandEntry(
        "evergym.discrepancy.blind.command", "Blind", "test the diagnosis on data in which an effect is hidden"
    ),
    "duct make": CommandEntry("evergym.duct_models.commands", "DuctMake", "make ducts of a family, or from a mesh"),
    "duct check": CommandEntry("evergym.duct_models.commands", "DuctCheck", "check a mesh of your own"),
    "duct show": CommandEntry("evergym.duct_models.commands", "DuctShow", "draw a duct"),
}
"""Every command; one whose module is not installed is left out."""


class Command(Protocol):
    """What a command's dataclass offers."""

    def run(self) -> int:
        """Do the work and return the exit code."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Args:
        arguments: Words after the program's name; None: those of this process.

    Returns:
        0 if all went well, 1 for an error that a message on stderr explains, 2 for a mistyped command, and for what
        play, replay and plot cannot show as asked, 130 after Ctrl-C.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    available = {name: entry for name, entry in COMMANDS.items() if _exists(entry.module)}
    if not words or words[0] in ("-h", "--help"):
        print(_describe(available))
        return 0
    if words[0] == "--version":
        import evergym

        print(f"evergym {evergym.__version__}")
        return 0
    name = words[0]
    groups = {command.split()[0] for command in available if " " in command}
    if name in groups:
        members = {command: entry for command, entry in available.items() if command.startswith(f"{name} ")}
        if len(words) < 2 or words[1] in ("-h", "--help"):
            print(_describe(members))
            return 0
        name = f"{name} {words[1]}"
    if name not in available:
        print(f"evergym: there is no command '{name}'{suggest(name, available)}", file=sys.stderr)
        return 2
    return _run(name, available[name], words[len(name.split()) :])


def _run(name: str, entry: CommandEntry, words: Sequence[str]) -> int:
    import tyro  # not needed for the list of commands

    _treat_termination_as_interrupt()
    try:
        kind: type[Command] = getattr(importlib.import_module(entry.module), entry.name)
        config = (tyro.conf.EnumChoicesFromValues, tyro.conf.FlagCreatePairsOff)
        description = inspect.getdoc(kind)
        command = tyro.cli(kind, prog=f"evergym {name}", description=description, args=words, config=config)
        return command.run()
    except EvergymError as error:
        print(f"evergym: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt as interrupt:
        print(f"\nInterrupted. {interrupt}".rstrip(), file=sys.stderr)
        return 130
    except BrokenPipeError:
        return 1  # the reader of a pipe such as `| head` has gone: nothing to say, and nobody to say it to
    except OSError as error:
        if error.filename is None:
            raise
        print(f"evergym: '{error.filename}': {error.strerror}.", file=sys.stderr)
        return 1


def _treat_termination_as_interrupt() -> None:
    """Let a command that is told to terminate end its processes first, as after Ctrl-C."""

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt("It was told to terminate.")

    if threading.current_thread() is threading.main_thread():
        signal.signal(signal.SIGTERM, interrupt)


def _exists(module: str) -> bool:
    return importlib.util.find_spec(module) is not None


def _describe(commands: dict[str, CommandEntry]) -> str:
    lines = ["usage: evergym <command> [options]", "", "commands:"]
    width = max(map(len, commands), default=0) + 2
    lines += [f"  {name:<{width}}{entry.summary}" for name, entry in commands.items()]
    return "\n".join([*lines, "", "evergym <command> --help lists the options of a command."])


if __name__ == "__main__":
    sys.exit(main())

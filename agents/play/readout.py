"""What the page says in words and numbers: the banner, the readings, the legend and the keys."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

from evergym.agents.play.episode import Frame, Heading
from evergym.agents.play.player import Mode
from evergym.agents.play.stage import COLOURS
from evergym.envs.drive import DriveLimits
from evergym.units import MM

__all__ = [
    "END_TEXT",
    "KEYS",
    "write_banner",
    "write_keys",
    "write_legend",
    "write_number",
    "write_readings",
    "write_replay_banner",
]

END_TEXT = {
    "reached": "Target reached",
    "burst": "The sheath has burst",
    "perforated": "The wall is perforated",
    "time": "Time is up",
    "diverged": "The simulation found no equilibrium",
}
"""What people are told at an episode's end."""

KEYS = (
    ("I", "K", "insert / withdraw the catheter"),
    ("J", "L", "turn it to either side"),
    ("O", "U", "pull / release the tendon"),
    ("M", "N", "raise / drop the pressure"),
    ("X", "", "stop insertion and turning"),
    ("C", "H", "duty cycle drives / take back"),
    ("P", "R", "pause / start again"),
    ("T", "", "save the episode"),
)
"""Keys and what they do. W, A, S, D, Q, E and the arrows move the camera, so the drives have others."""

_TONE = {"wait": "#1971c2", "go": "#495057", "held": "#d9480f", "good": "#2b8a3e", "bad": "#c92a2a"}
_NEAR = 0.1  # [mm] to the interlock's limit: a sheath that still grows a little lets the catheter follow that much


def write_banner(
    mode: Mode, driver: str, end_reason: str, frame: Frame, protrusion_max_mm: float = DriveLimits.protrusion / MM
) -> str:
    """Return the banner: what is going on, and what to do next.

    Args:
        mode: Of the player.
        driver: Who drives, of ``DRIVERS``.
        end_reason: Why the episode is over; empty while it lasts.
        frame: The latest.
        protrusion_max_mm: How far ahead of the sheath the interlock holds the catheter.
    """
    time_s = frame.values["time_s"]
    if mode is Mode.ENDED:
        good = end_reason == "reached"
        text = END_TEXT.get(end_reason, end_reason)
        more = f"after {time_s:.1f} s, tip error {frame.values['tip_error_mm']:.1f} mm. R starts again."
        return _banner("good" if good else "bad", ("✓ " if good else "✗ ") + text, more)
    if mode is Mode.READY:
        return _banner(
            "wait",
            "Ready",
            "Move a slider or press I: the clock starts with your first move. C lets the duty cycle drive.",
        )
    if mode is Mode.PAUSED:
        return _banner("wait", "Paused", "P goes on.")
    if driver == "hand":
        ahead = frame.values["catheter_length_mm"] - frame.values["everted_length_mm"]
        if frame.values["command_insertion_mm_s"] > 0.0 and ahead > protrusion_max_mm - _NEAR:
            title = f"Catheter held: {protrusion_max_mm:g} mm ahead of the sheath; raise the pressure (M)"
            return _banner("held", title, "You drive. It goes on as the sheath grows after it.")
        return _banner("go", "You drive", "Bring the tip to the green target. C hands over.")
    return _banner("go", f"The {driver} drives", "Any slider or key takes back.")


def write_replay_banner(heading: Heading, driver: str, at_end: bool) -> str:
    """Return the banner of a recorded episode: whose it is, and at its last frame how it ended."""
    place = f"{heading.env}, {heading.anatomy}, seed {heading.seed}, model {heading.model}"
    if at_end and heading.end_reason:
        mark = "✓ " if heading.is_success else "✗ "
        text = END_TEXT.get(heading.end_reason, heading.end_reason)
        return _banner("good" if heading.is_success else "bad", mark + text, place)
    return _banner("go", f"Recorded: {driver} drives", place)


def write_readings(frame: Frame) -> str:
    """Return the readings as a small table."""
    v = frame.values
    flags = [word for word, on in (("buckled", v["buckled"]), ("burst", v["burst"])) if on]
    rows = (
        ("tip x, y, z", f"{', '.join(write_number(v[f'tip_{axis}_mm'], 1) for axis in 'xyz')} mm", "tip"),
        ("tip error", f"{v['tip_error_mm']:.1f} mm", "tip-error"),
        ("everted length", f"{v['everted_length_mm']:.1f} mm", "everted"),
        ("catheter inserted", f"{v['catheter_length_mm']:.1f} mm", "catheter"),
        ("pressure", f"{v['pressure_kpa']:.1f} kPa", "pressure"),
        ("tendon pull", f"{v['tendon_pull_mm']:.2f} mm", "pull"),
        ("wall force, largest section", f"{v['wall_force_max_n']:.3f} N", "force"),
        ("wall force, sum", f"{v['wall_force_n']:.3f} N", "force-sum"),
        ("time", f"{v['time_s']:.1f} s{' · ' + ', '.join(flags) if flags else ''}", "time"),
    )
    cells = "".join(
        f'<tr><td style="color:#868e96;padding:0 8px 0 0">{name}</td>'
        f'<td data-reading="{key}" style="text-align:right;font-variant-numeric:tabular-nums">{text}</td></tr>'
        for name, text, key in rows
    )
    style = "width:100%;font-size:13px;line-height:1.45"
    return f'<div style="padding:2px 12px 4px"><table style="{style}">{cells}</table></div>'


def write_number(value: float, digits: int) -> str:
    """Return a number with so many decimals, and never "-0"."""
    return f"{round(value, digits) + 0.0:.{digits}f}"


def write_legend() -> str:
    """Return what the colours on the canvas mean."""
    words = {
        "wall": "duct wall",
        "sheath": "sheath",
        "catheter": "catheter",
        "tendon": "tendon and its side: pulling bends the tip this way",
        "target": "target, a pin over it, and the way to it",
        "contact": "contact force on the wall",
    }
    dot = "display:inline-block;width:10px;height:10px;border-radius:5px;margin-right:6px"
    items = "".join(
        f'<div><span style="{dot};background:rgb{COLOURS[key]}"></span>{text}</div>' for key, text in words.items()
    )
    return f'<div style="padding:2px 12px 6px;font-size:12px;line-height:1.5">{items}</div>'


def write_keys(policy: bool) -> str:
    """Return the table of keys."""
    keys: Sequence[tuple[str, str, str]] = KEYS
    if policy:
        keys = (*KEYS, ("V", "", "the policy drives"))
    rows = "".join(
        f'<tr><td style="padding-right:10px;white-space:nowrap">{_key(one)} {_key(other)}</td><td>{text}</td></tr>'
        for one, other, text in keys
    )
    camera = "Mouse: turn, move and zoom the view; so do W A S D Q E and the arrows."
    return (
        f'<div style="padding:2px 12px 8px;font-size:12px;line-height:1.7"><table>{rows}</table>'
        f'<div style="color:#868e96">{camera}</div></div>'
    )


def _banner(tone: str, title: str, text: str) -> str:
    return (
        f'<div data-reading="banner" style="margin:4px 12px;padding:8px 12px;border-radius:6px;color:#fff;'
        f'background:{_TONE[tone]}"><b style="font-size:16px">{escape(title)}</b>'
        f'<div style="font-size:12px;line-height:1.35">{escape(text)}</div></div>'
    )


def _key(name: str) -> str:
    style = "border:1px solid #adb5bd;border-radius:3px;padding:0 5px;font-size:11px;background:#f8f9fa;color:#212529"
    return f'<kbd style="{style}">{name}</kbd>' if name else ""

"""The page to drive the robot on: canvas, instruments, and the controls, whose callbacks only post requests."""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from functools import partial
from typing import Any

import viser

from evergym.agents.play.episode import DRIVERS, Frame
from evergym.agents.play.hand import DriveName, Hand
from evergym.agents.play.instruments import Instruments
from evergym.agents.play.loop import Pace
from evergym.agents.play.player import SPEEDS, Mode, Player
from evergym.agents.play.readout import write_banner, write_keys, write_legend, write_readings
from evergym.agents.play.stage import Stage
from evergym.compilation import announce_compilation
from evergym.duct_models.family import FAMILIES
from evergym.duct_models.peg_family import PEG_FAMILIES
from evergym.errors import EvergymError
from evergym.units import MM

__all__ = ["PlayPage"]

_SLIDERS = {
    DriveName.INSERTION: ("Insert, mm/s (I, K)", 0.1),
    DriveName.ROLL: ("Roll, deg/s (J, L)", 1.0),
    DriveName.PULL: ("Pull, mm (O, U)", 0.1),
    DriveName.PRESSURE: ("Pressure, kPa (M, N)", 0.5),
}
_KEYS = {
    "I": (DriveName.INSERTION, 1),
    "K": (DriveName.INSERTION, -1),
    "J": (DriveName.ROLL, 1),
    "L": (DriveName.ROLL, -1),
    "O": (DriveName.PULL, 1),
    "U": (DriveName.PULL, -1),
    "M": (DriveName.PRESSURE, 1),
    "N": (DriveName.PRESSURE, -1),
}
_FIELDS = {"family": "Family", "index": "Number", "target": "Target", "duct": "Mesh file"}
_PICTURE_EVERY = 2
_PLOTS_EVERY = 6


class PlayPage:
    """Shows a player and posts what people ask of it; `draw` is called by the thread that owns the player.

    Args:
        server: The page's server.
        player: The player.
    """

    def __init__(self, server: viser.ViserServer, player: Player) -> None:
        self._server, self._player = server, player
        self._stage = Stage(server)
        self._instruments = Instruments(server)
        self._place_number = -1
        self._drawn = 0
        self._shown: Frame | None = None
        server.gui.main_panel.dock_right()
        server.gui.main_panel.set_width(340)
        self._add_readings()
        self._add_drives()
        self._add_steering()
        self._add_episode()
        with server.gui.add_folder("Keys"):
            server.gui.add_html(write_keys(policy=True))
        self._add_hotkeys()

    def draw(self, pace: Pace | None = None) -> None:
        """Show the player's latest frame, all of it at once."""
        player, frame = self._player, self._player.frame
        with self._server.atomic():
            if player.place_number != self._place_number:
                self._build_place()
            self._show_drives()
            self._banner.content = write_banner(
                player.mode,
                player.driver,
                player.session.end_reason,
                frame,
                player.session.env.drive.limits.protrusion / MM,
            )
            moving = frame is not self._shown
            if moving:
                self._stage.show(frame)
                self._readings.content = write_readings(frame)
            # A still robot costs nothing, but the last picture of an episode has to be its end.
            rest = player.mode is not Mode.RUNNING
            if moving and (rest or self._drawn % _PICTURE_EVERY == 0):
                self._instruments.show_picture(frame)
            if moving and (rest or self._drawn % _PLOTS_EVERY == 0):
                self._instruments.show_plots(player.session.frames)
            self._shown = frame
            if pace is not None and self._drawn % 24 == 0:
                self._pace.content = _write_pace(pace, player.speed)
        self._drawn += 1
        self._show_notices()

    def close(self) -> None:
        """Free what is drawn with."""
        self._instruments.close()

    # Widgets

    def _add_readings(self) -> None:
        gui = self._server.gui
        self._banner = gui.add_html("")
        self._readings = gui.add_html("")

    def _add_drives(self) -> None:
        gui, hand = self._server.gui, self._player.session.hand
        self._sliders: dict[DriveName, viser.GuiSliderHandle[float]] = {}
        with gui.add_folder("Drives"):
            for drive, (label, step) in _SLIDERS.items():
                low, high = (round(value / Hand.unit(drive)[1], 3) for value in hand.range(drive))
                slider = gui.add_slider(label, min=low, max=high, step=step, initial_value=0.0)
                slider.on_update(partial(self._on_slider, drive))
                self._sliders[drive] = slider

    def _add_steering(self) -> None:
        gui, player = self._server.gui, self._player
        with gui.add_folder("Who drives"):
            hand, duty_cycle, policy = (partial(player.hand_over, driver) for driver in DRIVERS)
            self._button("Duty cycle drives (C)", duty_cycle, icon=viser.Icon.ROBOT, color="blue")
            self._policy_button = self._button("Policy drives (V)", policy, icon=viser.Icon.BRAIN)
            self._button("Take back (H)", hand, icon=viser.Icon.HAND_STOP)
            with gui.add_folder("Another policy", expand_by_default=False):
                folder = gui.add_text("Run folder", str(player.session.policy_folder or ""))
                self._button("Load", lambda: player.load_policy(folder.value), icon=viser.Icon.DOWNLOAD)

    def _add_episode(self) -> None:
        gui, player = self._server.gui, self._player
        env = player.session.env
        anatomy, self._ducts = player.session.anatomy, "duct" in env.option_names
        families = tuple(FAMILIES) if self._ducts else (*PEG_FAMILIES, "paper")
        with gui.add_folder("Episode"):
            self._button("Start again (R)", player.reset, icon=viser.Icon.ROTATE)
            self._button("Pause / go on (P)", player.pause, icon=viser.Icon.PLAYER_PAUSE)
            self._button("Save (T)", player.save, icon=viser.Icon.DEVICE_FLOPPY)
            every = gui.add_checkbox("Save all", player.save_all, hint="Save every episode when it ends")
            speeds = tuple(f"{value} x" for value in SPEEDS)
            speed = gui.add_dropdown("Speed", speeds, initial_value=f"{player.speed} x")
            self._pace = gui.add_html("")
        with gui.add_folder("Anatomy"):
            family = str(anatomy.get("anatomy_family"))
            self._family = gui.add_dropdown(
                "Family", families, initial_value=family if family in families else families[0]
            )
            self._index = gui.add_number("Number", max(int(anatomy.get("anatomy_index", 0)), 0), min=0, step=1)
            self._target = gui.add_number(
                "Target", int(anatomy.get("target_index", 0)), min=0, step=1, visible=self._ducts
            )
            self._seed = gui.add_number("Seed", player.session.seed, min=0, step=1)
            self._mesh = gui.add_text(
                "Mesh file",
                str(player.session.options.get("duct", "")),
                visible=self._ducts,
                hint="STL, OBJ, PLY, GLB or duct.toml; instead of family and number",
            )
            self._button("Go there", self._go, icon=viser.Icon.MAP_PIN)
        with gui.add_folder("What you see"):
            gui.add_html(write_legend())

        @every.on_update
        def _(_: Any) -> None:
            player.save_all = bool(every.value)

        @speed.on_update
        def _(_: Any) -> None:
            player.speed = SPEEDS[speeds.index(speed.value)]

    def _add_hotkeys(self) -> None:
        player = self._player
        for key, (drive, direction) in _KEYS.items():
            label = f"{_SLIDERS[drive][0].partition(',')[0]} {'up' if direction > 0 else 'down'}"
            command = self._server.gui.add_command(label, hotkey=key)  # type: ignore[arg-type]  # a letter
            command.on_trigger(partial(self._on_drive_key, drive, direction))
        for key, label, action in (
            ("X", "Stop", player.stop),
            ("C", "Duty cycle drives", partial(player.hand_over, DRIVERS[1])),
            ("V", "Policy drives", partial(player.hand_over, DRIVERS[2])),
            ("H", "Take back", partial(player.hand_over, DRIVERS[0])),
            ("P", "Pause or go on", player.pause),
            ("R", "Start again", player.reset),
            ("T", "Save the episode", player.save),
        ):
            self._hotkey(label, key, action)

    def _button(self, label: str, action: Callable[[], Any], **how: Any) -> viser.GuiButtonHandle:
        button = self._server.gui.add_button(label, **how)
        button.on_click(lambda _: self._player.post(action))
        return button

    def _hotkey(self, label: str, key: Any, action: Callable[[], Any]) -> None:
        self._server.gui.add_command(label, hotkey=key).on_trigger(lambda _: self._player.post(action))

    def _on_drive_key(self, drive: DriveName, direction: int, _: Any) -> None:
        # Timed here: when it is answered depends on how busy the simulator is.
        self._player.post(partial(self._player.press, drive, direction, time.monotonic()))

    async def _on_slider(self, drive: DriveName, event: Any) -> None:
        # A coroutine is run as soon as the message is received; a function would be run by another thread, later, when
        # the page has likely put the slider back to where the drive still is.
        if event.client_id is None:
            return  # the page itself has moved it, to where the drive is
        value = float(event.target.value) * Hand.unit(drive)[1]
        self._player.post(partial(self._player.set_drive, drive, value))

    # What is drawn

    def _go(self) -> None:
        """Go to the chosen anatomy."""
        options: dict[str, Any]
        if self._ducts and self._mesh.value.strip():
            options = {"duct": self._mesh.value.strip()}
        else:
            options = {"family": self._family.value, "index": int(self._index.value)}
        if self._ducts:
            options["target"] = int(self._target.value)
        notes = self._notify("Building the place", "A new anatomy takes some seconds.", loading=True)

        def tell(text: str) -> None:
            print(text, flush=True)
            notes.extend(self._notify("One moment", text, loading=True))

        try:
            with announce_compilation(tell):
                self._player.reset(int(self._seed.value), options)
        except EvergymError as error:
            self._show_place()  # the fields are to say where the robot is
            raise type(error)(_name_fields(str(error))) from None
        finally:
            for handle in notes:
                handle.remove()

    def _build_place(self) -> None:
        session = self._player.session
        self._instruments.place(session.scene, session.target)
        self._stage.place(session.scene, session.target, session.way, self._player.frame)
        self._place_number = self._player.place_number
        self._policy_button.disabled = DRIVERS[2] not in session.drivers
        self._show_place()

    def _show_place(self) -> None:
        """Put the fields to the place that the robot is in."""
        session = self._player.session
        anatomy = session.anatomy
        if anatomy.get("anatomy_family") in self._family.options:
            _put(self._family, str(anatomy["anatomy_family"]))
            _put(self._index, int(anatomy["anatomy_index"]))
        _put(self._target, int(anatomy.get("target_index", 0)))
        _put(self._seed, session.seed)
        _put(self._mesh, str(session.options.get("duct", "")))

    def _show_drives(self) -> None:
        """Put the sliders where the drives are set, whoever has set them."""
        hand = self._player.driver == DRIVERS[0]
        values = self._player.session.hand.value if hand else self._player.session.commands()
        for drive, slider in self._sliders.items():
            value = round(values[drive] / Hand.unit(drive)[1], 2) + 0.0  # never -0
            _put(slider, min(max(value, slider.min), slider.max))

    def _show_notices(self) -> None:
        while self._player.notices:
            text, bad = self._player.notices.pop(0)
            self._notify("That does not work" if bad else "Done", text, color="red" if bad else "green")
        self._policy_button.disabled = DRIVERS[2] not in self._player.session.drivers

    def _notify(self, title: str, text: str, **how: Any) -> list[Any]:
        clients = self._server.get_clients().values()
        seconds = None if how.get("loading") else 12.0
        return [client.add_notification(title, text, auto_close_seconds=seconds, **how) for client in clients]


def _put(handle: Any, value: Any) -> None:
    """Set a widget's value on all pages; the widgets' types call it read-only."""
    handle.value = value


def _name_fields(text: str) -> str:
    """Return an error's text with the options of the reset named as the page's fields are."""
    return re.sub(r"options\['(\w+)'\]", lambda match: _FIELDS.get(match[1], match[1]), text)


def _write_pace(pace: Pace, speed: int) -> str:
    text = f"{pace.rate:.0f} updates a second, {speed} x real time, {100.0 * pace.busy:.0f} % busy"
    return f'<div data-reading="pace" style="padding:0 12px 4px;font-size:12px;color:#868e96">{text}</div>'

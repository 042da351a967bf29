"""The page to look at recorded episodes on: the same canvas and instruments, and a slider for the time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import viser

from evergym.agents.play.episode import Frame
from evergym.agents.play.instruments import Instruments
from evergym.agents.play.readout import write_legend, write_readings, write_replay_banner
from evergym.agents.play.reel import Reel
from evergym.agents.play.stage import Stage

__all__ = ["ReplayPage"]

_SPEEDS = {"1/4 x": 0.25, "1/2 x": 0.5, "1 x": 1.0, "2 x": 2.0, "4 x": 4.0, "8 x": 8.0}
_PICTURE_EVERY = 2
_PLOTS_EVERY = 6


class ReplayPage:
    """Shows a reel and posts what people ask of it; `draw` is called by the thread that owns the reel.

    Args:
        server: The page's server.
        reel: The reel.
        files: Further episodes to choose from.
    """

    def __init__(self, server: viser.ViserServer, reel: Reel, files: Sequence[Path] = ()) -> None:
        self._server, self._reel = server, reel
        self._stage = Stage(server)
        self._instruments = Instruments(server)
        self._place_number = -1
        self._drawn = 0
        self._shown: Frame | None = None
        self._gone: viser.GuiSliderHandle[float] | None = None
        gui = server.gui
        gui.main_panel.dock_right()
        gui.main_panel.set_width(340)
        self._banner = gui.add_html("")
        self._readings = gui.add_html("")
        self._folder = gui.add_folder("Replay")
        with self._folder:
            button = gui.add_button("Play / stop (P)", icon=viser.Icon.PLAYER_PLAY, color="blue")
            button.on_click(lambda _: reel.post(reel.play))
            speed = gui.add_dropdown("Speed", tuple(_SPEEDS), initial_value="1 x")
            if len(files) > 1:
                names = {path.name: path for path in files}
                chosen = gui.add_dropdown("Episode", tuple(names))
                chosen.on_update(lambda _: reel.post(partial(reel.open, names[chosen.value])))
        with gui.add_folder("What you see"):
            gui.add_html(write_legend())
        for key, label, action in (
            ("P", "Play or stop", reel.play),
            ("L", "Next frame", partial(reel.step, 1)),
            ("J", "Frame before", partial(reel.step, -1)),
            ("R", "To the start", partial(reel.seek, 0.0)),
        ):
            self._hotkey(key, label, action)

        @speed.on_update
        def _(_: Any) -> None:
            reel.speed = _SPEEDS[speed.value]

    def draw(self) -> None:
        """Show the reel's frame, all of it at once."""
        reel = self._reel
        with self._server.atomic():
            if reel.place_number != self._place_number:
                self._build_place()
            frame = reel.frame
            if frame is not self._shown:
                heading = reel.episode.heading
                self._stage.show(frame)
                self._banner.content = write_replay_banner(heading, reel.driver, reel.at_end)
                self._readings.content = write_readings(frame)
                if self._gone is not None:
                    self._put_time(frame.values["time_s"])
                if not reel.playing or self._drawn % _PICTURE_EVERY == 0:
                    self._instruments.show_picture(frame)
                if not reel.playing or self._drawn % _PLOTS_EVERY == 0:
                    self._instruments.show_plots(reel.episode.frames[: reel.number + 1], reel.duration)
                self._shown = frame
        self._drawn += 1
        while reel.notices:
            text, _ = reel.notices.pop(0)
            for client in self._server.get_clients().values():
                client.add_notification("That does not work", text, color="red", auto_close_seconds=12.0)

    def close(self) -> None:
        """Free what is drawn with."""
        self._instruments.close()

    def _build_place(self) -> None:
        reel = self._reel
        episode = reel.episode
        self._instruments.place(episode.scene, episode.target)
        self._stage.place(episode.scene, episode.target, episode.way, reel.frame)
        if self._gone is not None:
            self._gone.remove()
        with self._folder:
            end = max(math.ceil(10.0 * reel.duration - 1e-6) / 10.0, 0.1)  # the last frame can be reached
            self._gone = self._server.gui.add_slider(
                "Time, s (J/L)", min=0.0, max=end, step=0.1, initial_value=0.0, order=-1.0
            )
        self._gone.on_update(self._on_slider)
        self._place_number = reel.place_number

    async def _on_slider(self, event: Any) -> None:  # as in PlayPage: read before the page puts it back
        if event.client_id is not None:
            self._reel.post(partial(self._reel.seek, float(event.target.value)))

    def _put_time(self, time: float) -> None:
        slider: Any = self._gone
        slider.value = min(round(time, 1), slider.max)

    def _hotkey(self, key: Any, label: str, action: Any) -> None:
        self._server.gui.add_command(label, hotkey=key).on_trigger(lambda _: self._reel.post(action))

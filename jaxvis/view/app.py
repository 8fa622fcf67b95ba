"""The viewer in the browser, by viser: orbit, turn the light, pick a method, watch its error."""

import math
import threading
import time
import warnings
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jaxvis import methods
from jaxvis.compare.run import one_line
from jaxvis.lighting import Environment
from jaxvis.scene import Camera, Scene, default_camera
from jaxvis.view.session import Frame, Look, Session

if TYPE_CHECKING:
    from viser import ClientHandle, GuiApi

SLOW = 0.12
"""Seconds of a frame from which on quicker ones are shown while something moves."""

STILL = 0.5
"""Seconds that nothing has moved before a reference is rendered."""

MOST_SAMPLES = 256
"""Frames of a method with noise that are averaged while nothing moves."""

SPIN = math.radians(45.0)
"""Radians a second."""

WIDTH_STEP = 32
"""Widths are multiples of it: programs are compiled for each size of image."""


class App:
    """A viewer that runs until :meth:`stop`; a notebook in a browser on this machine shows it.

    The image behind the browser's (empty) scene is that of the method: a quicker one while
    something moves, if frames are slow, then whole, then, where there is noise, the mean of more
    and more frames. Once nothing has moved for a while, a reference is rendered aside, and with it
    the PSNR and the error map.

    Args:
        scene, environment: what is looked at.
        method: a name with parameters, to begin with.
        camera: to begin with; by default the scene's own, or one that frames it.
        height: of the images, in pixels; their width follows the window's.
        host, port: where the server listens; a port that is taken gives way to the next free one.

    Raises:
        ModuleNotFoundError: viser is not installed.
        ValueError: there is no such method, or a height below 1.
    """

    def __init__(
        self,
        scene: Scene,
        environment: Environment,
        method: str = "correspondence",
        *,
        camera: Camera | None = None,
        height: int = 256,
        host: str = "127.0.0.1",
        port: int = 8080,
    ) -> None:
        try:
            import viser
        except ModuleNotFoundError as error:
            raise ModuleNotFoundError(
                'the viewer needs viser: pip install "jaxvis[view]"'
            ) from error
        methods.create(method)
        if height < 1:
            raise ValueError(f"height must be at least 1, got {height}")
        self.height = height
        self._camera = camera or scene.camera or default_camera(scene, aspect=4.0 / 3.0)
        self._session, self._truth = Session(scene, environment), Session(scene, environment)
        # A window may be closed while its frame is made.
        warnings.filterwarnings("ignore", "Queued a .* on a closed connection")
        self._server = viser.ViserServer(host=host, port=port, label="jaxvis", verbose=False)
        self._controls = Controls.of(self._server.gui, method)
        self._place_camera()
        self._views: dict[int, View] = {}
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="jaxvis-reference")
        self._stopped = threading.Event()
        self._thread = threading.Thread(target=self._run, name="jaxvis-view", daemon=True)
        self._thread.start()

    @property
    def url(self) -> str:
        """Where it is."""
        return f"http://{self._server.get_host()}:{self._server.get_port()}"

    def _repr_html_(self) -> str:
        return f'<iframe src="{self.url}" width="100%" height="600" style="border:0"></iframe>'

    def wait(self) -> None:
        """Until :meth:`stop`, or Ctrl+C."""
        self._stopped.wait()

    def stop(self) -> None:
        """Closes the server."""
        self._stopped.set()
        self._thread.join()
        self._pool.shutdown(cancel_futures=True)
        self._server.stop()

    def _place_camera(self) -> None:
        self._server.scene.set_up_direction("+y")
        first = self._server.initial_camera
        first.position, first.look_at, first.up = (
            np.asarray(place) for place in (self._camera.eye, self._camera.target, self._camera.up)
        )
        first.fov = self._camera.field_of_view

    def _run(self) -> None:
        turned = time.perf_counter()
        while not self._stopped.is_set():
            now = time.perf_counter()
            if self._controls.spin.value:
                self._controls.turn_by(SPIN * (now - turned))
            turned = now
            clients = self._server.get_clients()
            self._views = {key: self._views.get(key, View()) for key in clients}
            worked = [self._advance(client, self._views[key]) for key, client in clients.items()]
            if not any(worked):
                time.sleep(0.01)

    def _advance(self, client: "ClientHandle", view: "View") -> bool:
        """One step of a window towards what it should show; whether there was any to do."""
        look = self._look(client)
        if look is None:
            return False
        if look != view.look:
            view.begin(look)
        try:
            frame = self._next_frame(view)
            if frame is not None:
                view.took(frame)
            reference = self._reference(view)
        except Exception as error:  # whatever it is, the window stays alive and says it
            self._controls.status.content = f"**{one_line(error)}**"
            view.refused = True
            return True
        if frame is None and not reference and view.shown == self._controls.display:
            return False
        self._show(client, view)
        return True

    def _look(self, client: "ClientHandle") -> Look | None:
        camera = client.camera
        width = max(1, round(self.height * camera.aspect / WIDTH_STEP)) * WIDTH_STEP
        try:
            eye, target = (tuple(place.tolist()) for place in (camera.position, camera.look_at))
            place = Camera(eye, target, self._camera.up, float(camera.fov))
        except ValueError:  # straight up or down
            return None
        return Look(self._controls.name, place, (width, self.height), self._controls.yaw)

    def _next_frame(self, view: "View") -> Frame | None:
        look, frame = view.look, view.frame
        if look is None or view.refused:
            return None
        if frame is None:
            slow = view.full_seconds.get(look.method, 0.0) > SLOW
            return self._session.frame(replace(look, quick=slow))
        if frame.look != look:
            return self._session.frame(look)
        if frame.samples < MOST_SAMPLES and methods.create(look.method).stochastic:
            return frame.with_more(self._session.frame(look, seed=frame.samples))
        return None

    def _reference(self, view: "View") -> bool:
        """Whether there is a reference now that there was not before."""
        look, frame = view.look, view.frame
        still = time.perf_counter() - view.since > STILL
        wanted = self._controls.compare.value and still and not view.refused
        if not (wanted and frame and frame.look == look):
            return False
        if view.waiting is None and view.reference is None:
            view.waiting = self._pool.submit(self._truth.reference, frame.look)
        if view.waiting is None or not view.waiting.done():
            return False
        done, view.waiting = view.waiting, None
        view.reference = done.result()
        return True

    def _show(self, client: "ClientHandle", view: "View") -> None:
        frame, reference = view.frame, view.reference
        if frame is None:
            return
        what, stops = self._controls.display
        exposure = frame.exposure * 2.0**stops
        if reference is None or reference.setting.size != frame.setting.size or what == "image":
            image = frame.shown(exposure)
        else:
            image = frame.error(reference) if what == "error" else reference.shown(exposure)
        client.scene.set_background_image(image, format="jpeg", jpeg_quality=90)
        view.shown = self._controls.display
        self._controls.status.content = status(view)


@dataclass
class View:
    """What one window shows."""

    look: Look | None = None
    frame: Frame | None = None
    reference: Frame | None = None
    waiting: "Future[Frame] | None" = None
    since: float = 0.0
    refused: bool = False
    shown: tuple[str, float] | None = None
    full_seconds: dict[str, float] = field(default_factory=dict)
    """What the last whole frame of each method took."""
    times: list[float] = field(default_factory=list)
    """When the last frames came."""

    def begin(self, look: Look) -> None:
        """Something has changed."""
        if self.waiting is not None:
            self.waiting.cancel()
        if self.look is not None and replace(look, method=self.look.method) != self.look:
            self.reference = None
        self.look, self.frame, self.waiting, self.refused = look, None, None, False
        self.since = time.perf_counter()

    def took(self, frame: Frame) -> None:
        """A frame has come."""
        if frame.look == self.look and frame.samples == 1:
            self.full_seconds[frame.look.method] = frame.seconds
        self.frame = frame
        self.times = [*self.times[-19:], time.perf_counter()]

    @property
    def rate(self) -> float | None:
        """Frames a second, over the last second and a half."""
        recent = [at for at in self.times if self.times[-1] - at < 1.5]
        return (len(recent) - 1) / (recent[-1] - recent[0]) if len(recent) > 2 else None


def status(view: View) -> str:
    """What is said below the controls."""
    frame = view.frame
    if frame is None:
        return ""
    width, height = frame.setting.size
    parts = [f"{1000.0 * frame.seconds:.0f} ms", f"{width} x {height}"]
    if frame.samples > 1:
        parts.append(f"mean of {frame.samples}")
    if view.rate is not None:
        parts.append(f"{view.rate:.1f} frames/s")
    reference = view.reference
    if reference is not None and reference.setting.size != frame.setting.size:
        reference = None
    value = None if reference is None else frame.psnr(reference)
    parts.append("PSNR -" if value is None else f"PSNR {value:.1f} dB")
    return " · ".join(parts)


@dataclass(frozen=True)
class Controls:
    """What is beside the image."""

    method: Any
    parameters: Any
    turn: Any
    spin: Any
    show: Any
    stops: Any
    compare: Any
    status: Any

    @classmethod
    def of(cls, gui: "GuiApi", method: str) -> "Controls":
        name, _, parameters = method.partition(":")
        names = list(dict.fromkeys([name, *methods.names()]))
        return cls(
            gui.add_dropdown("method", names, initial_value=name),
            gui.add_text("parameters", parameters, hint="as in zeta=1,vectors=64"),
            gui.add_slider("turn", 0.0, 360.0, 0.1, 0.0, hint="degrees about the vertical"),
            gui.add_checkbox("spin", False),
            gui.add_dropdown("show", ("image", "error", "reference"), initial_value="image"),
            gui.add_slider("exposure", -6.0, 6.0, 0.25, 0.0, hint="stops"),
            gui.add_checkbox("compare", True, hint="with a reference, once nothing moves"),
            gui.add_markdown(""),
        )

    @property
    def name(self) -> str:
        """The method with its parameters."""
        given = self.parameters.value.strip()
        return f"{self.method.value}:{given}" if given else self.method.value

    @property
    def yaw(self) -> float:
        return math.radians(self.turn.value)

    @property
    def display(self) -> tuple[str, float]:
        """(what is shown, stops)."""
        return self.show.value, self.stops.value

    def turn_by(self, yaw: float) -> None:
        self.turn.value = round((self.turn.value + math.degrees(yaw)) % 360.0, 1)

"""The viewer in a real browser: headless Chromium, by its WebDriver."""

import shutil
import time
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from jaxvis.view import App
from tests.interaction import light
from tests.methods.known_scenes import MATERIALS, SCENES

webdriver = pytest.importorskip("selenium.webdriver", reason="the driver of browsers is missing")
pytest.importorskip("viser", reason="the viewer's server is missing")
# pytest has filters of its own in place of the viewer's.
pytestmark = pytest.mark.filterwarnings("ignore:Queued a .* on a closed connection")
BROWSER, DRIVER = shutil.which("chromium"), shutil.which("chromedriver")
FLAGS = (
    *("--headless=new", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"),
    *("--disable-quic", "--no-first-run", "--disable-background-networking", "--disable-sync"),
    *("--disable-component-update", "--window-size=640,480"),
)
BOX = SCENES[2].with_material(*MATERIALS["diffuse"])


@pytest.fixture(scope="module")
def app(own_caches):
    app = App(BOX, light(0), "correspondence:vectors=16,resolution=16", height=64, port=18080)
    yield app
    app.stop()


@pytest.fixture(scope="module")
def browser(app):
    if BROWSER is None or DRIVER is None:
        pytest.skip("chromium or chromedriver is not installed")
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in FLAGS:
        options.add_argument(flag)
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    driver.get(app.url)
    yield driver
    driver.quit()


def wait_until(condition, seconds=120.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not come"
        time.sleep(0.05)


def picture(browser):
    """The part of the window that no control covers, [rows, columns, 3] in 0..255."""
    image = Image.open(BytesIO(browser.get_screenshot_as_png())).convert("RGB")
    return np.asarray(image, np.float64)[150:, :300]


def status(app):
    return app._controls.status.content


def test_the_window_shows_the_scene_its_error_and_its_light_turns(app, browser):
    wait_until(lambda: "dB" in status(app))
    time.sleep(1.0)
    still = picture(browser)
    assert still.std() > 10.0  # a picture, no empty window
    app._controls.show.value = "error"
    time.sleep(1.0)
    error = picture(browser)
    assert np.abs(error - still).mean() > 10.0
    assert error.mean() < 0.7 * still.mean()  # small errors are dark
    app._controls.show.value = "image"
    app._controls.turn.value = 90.0
    wait_until(lambda: "PSNR -" in status(app))
    time.sleep(1.0)
    assert np.abs(picture(browser) - still).mean() > 3.0
    wait_until(lambda: "dB" in status(app))


def test_a_camera_that_moves_is_followed(app, browser):
    before = picture(browser)
    (client,) = app._server.get_clients().values()
    client.camera.position = 1.5 * np.asarray(client.camera.position)
    (view,) = app._views.values()
    wait_until(lambda: view.look.camera.eye[1] > 1.2 * BOX.camera.eye[1])
    wait_until(lambda: view.frame is not None and view.frame.look == view.look)
    time.sleep(1.0)
    assert np.abs(picture(browser) - before).mean() > 3.0


def test_it_spins_while_frames_come(app, browser):
    before = app._controls.turn.value
    app._controls.spin.value = True
    wait_until(lambda: app._controls.turn.value != before and "frames/s" in status(app))
    app._controls.spin.value = False


def test_what_cannot_be_is_said_and_the_next_is_shown(app, browser):
    app._controls.parameters.value = "zeta=many"
    wait_until(lambda: "zeta must be float" in status(app))
    app._controls.method.value, app._controls.parameters.value = "mc-mis", "spp=1"
    wait_until(lambda: "mean of" in status(app))  # noise is averaged


def test_a_fault_does_not_end_it(app, browser, monkeypatch):
    def fail(look, seed=0):
        raise RuntimeError("out of memory")

    with monkeypatch.context() as patch:
        patch.setattr(app._session, "frame", fail)
        app._controls.turn.value = 10.0
        wait_until(lambda: "RuntimeError: out of memory" in status(app))
    app._controls.turn.value = 20.0
    wait_until(lambda: "ms" in status(app))


def test_a_notebook_shows_it_in_place(app, browser, tmp_path):
    """What a notebook puts into its page is the viewer with its picture."""
    page = tmp_path / "notebook.html"
    page.write_text(f"<p>before</p>{app._repr_html_()}<p>after</p>")
    browser.get(page.as_uri())
    wait_until(lambda: any(view.frame is not None for view in app._views.values()))
    inside = browser.find_element("tag name", "iframe").rect
    assert inside["width"] > 500

    def shown():
        left, top = round(inside["x"]), round(inside["y"])
        window = Image.open(BytesIO(browser.get_screenshot_as_png())).convert("RGB")
        return np.asarray(window, np.float64)[top : top + 300, left : left + 250]

    wait_until(lambda: shown().std() > 10.0)


def test_unknown_methods_and_sizes_are_refused_before_a_server_starts():
    with pytest.raises(ValueError, match="no-such"):
        App(BOX, light(0), "no-such")
    with pytest.raises(ValueError, match="height must be at least 1"):
        App(BOX, light(0), height=0)

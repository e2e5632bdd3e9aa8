"""The page without a server, in chromium: it drives, records, replays, works offline, and drives a board by Web Serial.

The board's port is not a browser's own (rigs/browser_robot.py).
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from time import monotonic, sleep
from typing import Any

import pytest

from rigs import browser_robot
from rigs.browser_robot import ARMED, START, Relay, arm, board, hold, renderers, serving, signalled
from rigs.patience import S
from tests.browser.conftest import browser, fresh, waits  # noqa: F401
from txt1.errors import ConfigError
from txt1_browser import site

pytestmark = pytest.mark.browser

# the very program: that of the other tests lives through longer stalls, and so would repeat another run
DESK = (sys.executable, "-m", "txt1")
STATE = browser_robot.STATE
X = "parseFloat(document.getElementById('where').textContent.split('x ')[1])"
BAD = "document.getElementById('browser-state').classList.contains('bad')"
NOTICE = "document.getElementById('browser-state').textContent"


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("browser") / "site"
    given = os.environ.get("TXT1_PYODIDE")
    try:
        site.build(made, None if given is None else Path(given), lambda text: None)
    except ConfigError as error:
        pytest.skip(f"the folder of files cannot be made here: {error}")
    return made


@pytest.fixture(scope="session")
def served(folder: Path) -> Iterator[str]:
    """The folder on a server of plain files; its address."""
    with serving(folder) as url:
        yield url


@pytest.fixture
def page(browser: Any, served: str) -> Iterator[Any]:  # noqa: F811
    page = fresh(browser, accept_downloads=True)
    page.goto(served)
    assert waits(page, ARMED, START)
    yield page
    page.context.close()


def notice(page: Any) -> str:
    return str(page.evaluate(NOTICE))


def drive(page: Any, s: float = 2.0) -> None:
    """Hold w for s seconds, anew where a busy computer has the page let go."""
    before = page.evaluate(X)
    for _ in range(10):
        page.keyboard.down("w")
        sleep(s)
        page.keyboard.up("w")
        if abs(page.evaluate(X) - before) > 0.1:
            return
    raise AssertionError("it does not drive")


def saved(page: Any, target: Path) -> Path:
    """Complete the recording of the run by a new start, and save it."""
    page.click("#restart")
    assert waits(page, ARMED, START)
    page.click("[data-tab=files]")
    assert waits(page, "document.querySelectorAll('a[download]').length >= 2")
    with page.expect_download() as download:
        page.locator("a[download]").last.click()
    download.value.save_as(target)
    return target


def test_a_key_drives_and_letting_go_stops(page: Any) -> None:
    drive(page)
    assert waits(page, "document.getElementById('v-now').textContent === '0 m/s'")


def test_the_space_bar_stops_and_m_arms(page: Any) -> None:
    page.keyboard.press(" ")
    assert waits(page, f"{STATE} === 'stopped'")
    arm(page)


def test_a_second_start_before_the_first_run_has_ended_drives_one_robot(page: Any) -> None:
    page.dblclick("#restart")
    assert waits(page, ARMED, START)
    drive(page)
    page.click("[data-tab=files]")
    assert waits(page, "document.querySelectorAll('a[download]').length === 2"), "the first, and the present one"


def test_a_drive_is_saved_and_verified_on_the_desk(page: Any, tmp_path: Path) -> None:
    drive(page)
    file = saved(page, tmp_path / "browser.mcap")
    verified = subprocess.run([*DESK, "replay", "--verify", str(file)], capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stdout + verified.stderr


def test_a_drive_of_the_desk_is_verified_in_the_browser(page: Any, tmp_path: Path) -> None:
    file = tmp_path / "desk.mcap"
    run = ["run", "--headless", "--speed", "max", "--duration", "4", "--drive", "0.5,0.3", "--log", str(file)]
    subprocess.run([*DESK, *run], check=True, capture_output=True)
    page.set_input_files("#pick", str(file))
    assert waits(page, "[...document.querySelectorAll('a[download]')].some((each) => each.download === 'desk.mcap')")
    page.click("#verify")
    assert waits(page, "document.getElementById('browser-state').dataset.code !== undefined", START)
    assert page.evaluate("document.getElementById('browser-state').dataset.code") == "0", notice(page)
    assert "no difference" in notice(page)
    assert not page.evaluate(BAD)


def test_it_learns_with_its_table_and_curve_and_the_desk_verifies_what_was_recorded(page: Any, tmp_path: Path) -> None:
    page.click("#learn")
    assert waits(page, "document.querySelectorAll('#learner-episodes tr').length >= 2", 4 * START), notice(page)
    assert page.evaluate("document.querySelectorAll('#learner-table tbody tr').length") >= 2
    assert page.evaluate("document.getElementById('episodes-chart').width") > 0
    shown = page.evaluate("[...document.querySelectorAll('#learner-table td')].map((cell) => cell.textContent)")
    file = saved(page, tmp_path / "learned.mcap")
    verified = subprocess.run([*DESK, "replay", "--verify", str(file)], capture_output=True, text=True, check=False)
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert any(float(value) for value in shown[1:])


def test_a_learner_that_computes_with_numpy_is_refused_in_words(browser: Any, served: str) -> None:  # noqa: F811
    page = fresh(browser)
    page.goto(f"{served}?learn=locator")
    assert waits(page, "document.getElementById('browser-state').textContent.includes('not to be had')", START)
    page.context.close()


def test_it_opens_without_a_network_once_it_was_loaded(page: Any, served: str) -> None:
    assert waits(page, "navigator.serviceWorker.controller !== null", START)
    page.context.set_offline(True)
    page.goto(served)
    assert waits(page, ARMED, START)


def test_the_script_for_use_without_a_network_changes_with_every_file(folder: Path) -> None:
    """Browsers look for a new version of that script alone."""
    listed = (folder / "files.json").read_text()
    assert (folder / "offline.js").read_text().startswith(f"const site = {listed}\n")
    assert "packages.zip" in json.loads(listed)["files"]


def test_settings_in_the_address_are_those_of_the_desk(browser: Any, served: str) -> None:  # noqa: F811
    page = fresh(browser)
    page.goto(f"{served}?set=sim.start=[-1.5,0,0]&set=sim.room.length=8")
    assert waits(page, ARMED, START)
    assert page.evaluate(X) == pytest.approx(-1.5, abs=0.05)
    page.goto(f"{served}?set=safety.v_max=fast")
    assert waits(page, "document.getElementById('browser-state').textContent.includes('safety.v_max')", START)
    page.context.close()


def test_a_file_that_is_no_recording_is_refused_in_words(page: Any, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("hello")
    page.set_input_files("#pick", str(tmp_path / "notes.txt"))
    assert waits(page, "document.getElementById('browser-state').textContent.includes('it ends with .mcap')")


def test_on_a_phone_what_is_said_is_in_sight_where_its_button_is(page: Any) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.click("#verify")
    assert waits(page, f"{NOTICE}.includes('no recording is complete yet')")
    top, bottom = page.evaluate(
        "(({ top, bottom }) => [top, bottom])(document.getElementById('browser-state').getBoundingClientRect())"
    )
    assert 0 < top < bottom < 844
    assert page.evaluate(BAD)


def test_without_serial_ports_the_board_button_says_what_to_take(page: Any) -> None:
    page.evaluate("Object.defineProperty(navigator, 'serial', { value: undefined, configurable: true })")
    page.click("#board")
    assert "take Chrome or Edge" in notice(page)


def perform(page: Any, code: str) -> None:
    """Show the field of the program if it is not there yet, and run one."""
    if not page.is_visible("#program"):
        page.click("#perform")
    page.fill("#program", code)
    page.click("#perform")


def test_a_program_drives_and_its_mistake_is_told_with_its_line(page: Any) -> None:
    before = page.evaluate(X)
    perform(page, "for each in range(2):\n    await robot.drive(v=0.5, omega=0.0, duration=1.0)")
    assert waits(page, f"{NOTICE}.includes('the program has ended')", START), notice(page)
    assert not page.evaluate(BAD)
    assert page.evaluate(X) > before + 0.3
    perform(page, "v = 0.5\nawait robot.drive(v, w, 1.0)")
    assert waits(page, f"{NOTICE}.includes(\"the program, line 2: name 'w' is not defined\")", START), notice(page)
    perform(page, "while True")
    assert waits(page, f"{NOTICE}.includes('the program, line 1: ')", START), notice(page)


def test_an_endless_loop_is_ended_and_what_was_recorded_before_is_kept(page: Any, tmp_path: Path) -> None:
    drive(page)
    page.click("#restart")
    assert waits(page, ARMED, START)
    drive(page)
    perform(page, "while True:\n    pass")
    assert waits(page, f"{NOTICE}.includes('has hung for 10 s and was ended; the car stands')", START), notice(page)
    page.click("#restart")
    assert waits(page, ARMED, START)
    page.click("[data-tab=files]")
    assert waits(page, "document.querySelectorAll('a[download]').length === 3"), "two, and the present one"
    for number in (1, 2):
        file = tmp_path / f"{number}.mcap"
        with page.expect_download() as download:
            page.locator("a[download]").nth(number).click()
        download.value.save_as(file)
        verified = subprocess.run([*DESK, "replay", "--verify", str(file)], capture_output=True, text=True, check=False)
        assert verified.returncode == 0, verified.stdout + verified.stderr


def test_a_recording_of_another_version_is_refused_in_one_line(page: Any, tmp_path: Path) -> None:
    file = tmp_path / "other.mcap"
    run = ["run", "--headless", "--speed", "max", "--duration", "2", "--log", str(file)]
    subprocess.run([*DESK, *run], check=True, capture_output=True)
    # the configuration in the head of the file
    file.write_bytes(file.read_bytes().replace(b'"v_max"', b'"speed"', 1))
    page.set_input_files("#pick", str(file))
    page.click("#verify")
    assert waits(page, f"{NOTICE}.includes('its configuration is not one of this version')", START), notice(page)
    assert "\n" not in notice(page)


@pytest.mark.parametrize(
    ("lacking", "told"),
    [
        ("delete globalThis.WebAssembly", "this browser cannot run the robot: it has no WebAssembly"),
        ("Object.defineProperty(globalThis, 'isSecureContext', { value: false })", "need https or localhost"),
    ],
)
def test_what_a_browser_lacks_is_said_in_one_line(browser: Any, served: str, lacking: str, told: str) -> None:  # noqa: F811
    page = fresh(browser, service_workers="block")
    page.add_init_script(lacking)
    page.goto(served)
    assert waits(page, f"{NOTICE}.includes('{told}')", START), notice(page)
    page.context.close()


def test_a_page_from_disk_says_how_to_serve_it(browser: Any, folder: Path) -> None:  # noqa: F811
    page = fresh(browser)
    page.goto((folder / "index.html").as_uri())
    assert waits(page, "document.getElementById('reason').textContent.includes('python -m http.server')")
    page.context.close()


def test_a_full_storage_is_said_and_the_robot_drives_on(browser: Any, served: str) -> None:  # noqa: F811
    page = fresh(browser)
    quota = {"origin": served.removesuffix("/"), "quotaSize": 1_000_000}
    page.context.new_cdp_session(page).send("Storage.overrideQuotaForOrigin", quota)
    page.goto(served)
    assert waits(page, f"{NOTICE}.includes('it will not open without a network')", START), notice(page)
    assert waits(page, ARMED)
    drive(page)
    page.context.close()


# -- a board ------------------------------------------------------------------------------------------------------


@pytest.fixture
def relay(request: pytest.FixtureRequest) -> Iterator[Relay]:
    with board(getattr(request, "param", "ours")) as made:
        yield made


@pytest.fixture
def driven(browser: Any, folder: Path, served: str, relay: Relay) -> Iterator[Any]:  # noqa: F811
    # small, as drawing takes most of a busy computer's time
    page = fresh(browser, service_workers="block", viewport={"width": 480, "height": 360})
    with browser_robot.driven(page, folder, served, relay):
        yield page
        page.context.close()


def test_a_board_is_driven_by_web_serial_and_no_faster_than_half_a_metre(driven: Any, relay: Relay) -> None:
    since = monotonic()
    driven.keyboard.up("w")
    assert relay.stops_after(since) < 0.5 * S
    assert max(told.v for _, told in relay.told) <= 0.501


def worker(page: Any, script: str) -> Any:
    return next(each for each in page.workers if each.url.endswith(f"/{script}"))


@pytest.mark.parametrize("fate", ["self.close()", "setTimeout(() => { for (;;) {} })"], ids=["ended", "hung"])
def test_the_guard_stops_a_board_whose_robot_was_ended(driven: Any, relay: Relay, fate: str) -> None:
    since = monotonic()
    worker(driven, "worker.js").evaluate(fate)
    assert relay.stops_after(since) < 0.5 * S


def test_a_stop_goes_before_what_a_stuck_port_does_not_take(driven: Any, relay: Relay) -> None:
    driven.hover("#stop")
    worker(driven, "guard.js").evaluate("globalThis.portIsStuck = true")
    sleep(0.5 * S)
    since = monotonic()
    # a click would first wait for the page's next picture
    driven.mouse.down()
    assert relay.stops_after(since) < 0.5 * S
    assert relay.told[-1][0] > since, "the zeros came through"


def test_garbage_on_the_line_neither_ends_the_robot_nor_its_link(driven: Any, relay: Relay) -> None:
    relay.babble(bytes(range(256)) * 20)
    sleep(1.0 * S)
    assert waits(driven, "document.getElementById('link').textContent.endsWith('ms')")
    driven.keyboard.up("w")
    relay.stops_after(monotonic())
    hold(driven, relay)


@pytest.mark.parametrize("event", ["visibilitychange", "pagehide", "freeze", "blur"])
def test_a_page_that_is_left_stops_its_board_within_half_a_second(driven: Any, relay: Relay, event: str) -> None:
    since = monotonic()
    driven.evaluate(
        """(name) => {
            Object.defineProperty(document, "hidden", { value: name === "visibilitychange", configurable: true })
            const target = name === "visibilitychange" || name === "freeze" ? document : window
            target.dispatchEvent(new Event(name))
        }""",
        event,
    )
    assert relay.stops_after(since) < 0.5 * S


def test_an_unplugged_board_is_told_and_disarms(driven: Any, relay: Relay) -> None:
    relay.cut()
    assert waits(driven, f"{STATE} !== 'armed'")


@pytest.mark.parametrize(("relay", "longest"), [("ours", 0.25), ("original", 1.9)], indirect=["relay"])
def test_a_frozen_renderer_leaves_the_board_its_own_time_out(
    browser: Any,  # noqa: F811
    driven: Any,
    relay: Relay,
    longest: float,
) -> None:
    """The guard is frozen, too, so no zeros come: the board stops by itself, which an original does late."""
    processes = renderers(browser)
    hold(driven, relay)
    try:
        assert relay.frozen(lambda: signalled(processes, signal.SIGSTOP)) < longest + 0.5 * S
    finally:
        signalled(processes, signal.SIGCONT)


def test_a_killed_renderer_leaves_the_board_its_own_time_out(browser: Any, driven: Any, relay: Relay) -> None:  # noqa: F811
    processes = renderers(browser)
    hold(driven, relay)
    assert relay.frozen(lambda: signalled(processes, signal.SIGKILL)) < 0.25 + 0.5 * S

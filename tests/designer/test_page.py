"""The Designer's page in Chromium beside a model without a kernel: what a hand does to it, and an
audit by axe-core."""

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from browser import CHROMIUM, Page, browser, until

pytest.importorskip(
    "anywidget", reason="needs the extra `notebook`: pip install 'dobc_design[notebook]'"
)

import dobc_design as dd

pytestmark = [pytest.mark.slow, pytest.mark.skipif(CHROMIUM is None, reason="needs chromium")]
AXE = os.environ.get("AXE_SCRIPT", "")
KEYS = ("network", "arcs", "gains", "rate", "radius", "version", "numbers", "verdict")
# Answers at once, as a kernel whose estimates do not change; what is sent to it is kept.
MODEL = """
const sent = [], listeners = {};
const model = {
  get: (key) => values[key], set: (key, value) => { values[key] = value; }, send: (message) =>
  sent.push(message),
  on: (names, act) => names.split(" ").forEach((name) => { (listeners[name] ??= []).push(act); }),
  tell: (name, what) => (listeners[name] ?? []).forEach((act) => act(what)),
  save_changes: () => setTimeout(() => model.tell("change:numbers")),
};
render({ model, el: document.getElementById("designer") });
"""
AGENT = "document.querySelector('.dobc-agent[data-agent=\"{}\"]')"
GAIN = "document.querySelector('.dobc-gains input[type=number]')"


# Whatever reaches out of the page, out of its box (a scroll bar aside) or out of its drawing.
CUT = """(() => {
  const cut = [], page = document.documentElement;
  const isWithin = (box, drawing) => box.left >= drawing.left && box.right <= drawing.right
    && box.top >= drawing.top && box.bottom <= drawing.bottom;
  if (page.scrollWidth > page.clientWidth) cut.push("the page");
  for (const each of document.querySelectorAll(".dobc-designer *")) {
    const box = each.getBoundingClientRect(), drawing = each.ownerSVGElement;
    const isOut = drawing
      ? each.tagName === "text" && !isWithin(box, drawing.getBoundingClientRect())
      : each.clientWidth && each.scrollWidth > each.clientWidth + 1;
    if (isOut || box.right > page.clientWidth)
      cut.push(`${each.tagName} ${each.className} ${each.textContent || each.value}`);
  }
  return cut;
})()"""


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    with shown("paper-fixed", tmp_path_factory.mktemp("designer")) as opened:
        yield opened


@contextmanager
def shown(problem: dd.Problem | str, folder: Path) -> Iterator[Page]:
    """The page of a problem with its exact verdict."""
    designer = dd.Designer(problem)
    designer.certify()
    values = json.dumps({key: getattr(designer, key) for key in KEYS})
    script = (
        designer._esm.replace("export default { render };", f"const values = {values};") + MODEL
    )
    body = '<body><main><h1>Designer</h1><div id="designer"></div></main>'
    head = (
        '<!DOCTYPE html><html lang="en"><meta '
        f'charset="utf-8"><title>Designer</title><style>{designer._css}</style>'
    )
    (folder / "page.html").write_text(
        f"{head}{body}<script>{script}</script></body></html>", encoding="utf-8"
    )
    with browser(
        folder, (folder / "page.html").as_uri(), wanted="page.html", window="1000,1000"
    ) as opened:
        until(
            "the drawing",
            lambda: opened.run("document.querySelectorAll('.dobc-agent').length > 0"),
        )
        yield opened


def press(page: Page, key: str, **more: int) -> None:
    for kind in ("keyDown", "keyUp"):
        page.ask("Input.dispatchKeyEvent", type=kind, key=key, code=key, **more)


def mouse(page: Page, kind: str, agent: int) -> None:
    box = page.run(
        "(({x, y, width, height}) => [x + width / 2, y + height / "
        f"2])({AGENT.format(agent)}.getBoundingClientRect())"
    )
    page.ask("Input.dispatchMouseEvent", type=kind, x=box[0], y=box[1], button="left", clickCount=1)


def click(page: Page, text: str) -> None:
    page.run(
        "[...document.querySelectorAll('button')].find((each) => each.textContent === "
        f"'{text}').click()"
    )


def test_below_a_proved_verdict_stands_what_is_certain_and_the_proved_bound_is_drawn(page: Page):
    text = page.run("document.querySelector('.dobc-designer').innerText")
    assert text.count("PROVED") == 1
    assert "Proved: Theorem 1; " in text
    assert "proved: from these starts no agent is ever above it" in text
    for guess in ("may hold", "should", "expected", "Inputs"):
        assert guess not in text
    heights = page.run(
        "[...document.querySelectorAll('.dobc-curve')].map((each) => "
        "each.getAttribute('points').split(' ').map((point) => Number(point.split(',')[1])))"
    )
    *agents, bound = heights
    assert len(agents) == 10
    for agent in agents:  # heights are counted from above
        for low, high in zip(agent, bound, strict=True):
            assert low >= high


@pytest.mark.parametrize(
    ("changes", "wanted"),
    [
        ({"rate": None}, "No decay rate is proved."),
        ({"rate": "0.01"}, "The proved rate is below the wanted one, 0.05 1/s."),
        ({"bound": {"text": "a bound", "tube": [], "level": 99}}, "a bound (above the drawing)"),
        ({"bound": {"text": "a bound", "tube": [], "level": 2}}, "a bound\n"),
        ({"verdict": "undecided"}, "At the wanted rate, starts within 4 of the target should"),
    ],
)
def test_what_a_verdict_leaves_open_is_said(page: Page, changes: dict[str, object], wanted: str):
    page.run("window.before = values.verdict")
    page.run(f"values.verdict = {{...before, ...{json.dumps(changes)}}}")
    page.run("model.tell('change:verdict')")
    assert wanted in page.run("document.querySelector('.dobc-designer').innerText")
    page.run("values.verdict = before; model.tell('change:verdict')")


def long_labels() -> dd.Problem:
    """Names as people give them, an actuator that is too small and a gain of many digits."""
    labels = ["north ridge sensor", "south ridge sensor", "pump station 4", "compressor-7", "b"]
    arcs = [[labels[k], labels[k - 1]] for k in range(1, 5)]
    return dd.Problem(
        network=dd.Network.from_arcs(arcs, arrow="listens_to", agents=labels),
        coupling="y",
        gains={labels[0]: "1000.125"},
        name="a plant with a rather long name",
        region={"initial_states": [-5000, 5000]},
        units="litres/minute",
        actuators={"limit": 20},
    )


@pytest.mark.parametrize("width", [1280, 390])
def test_nothing_is_cut_on_a_screen_or_a_phone(width: int, tmp_path: Path):
    with shown(long_labels(), tmp_path) as page:
        page.ask(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=900,
            deviceScaleFactor=1,
            mobile=False,
        )
        until("the width", lambda: page.run("innerWidth") == width)
        assert page.run(CUT) == []
        text = page.run("document.querySelector('.dobc-designer').innerText")
        assert "UNDECIDED. Without the actuator limit" in text
        assert "Inputs: not proved to keep the limit of 20." in text
        assert "distance from the goal, in litres/minute" in text
        labels = page.run(
            "[...document.querySelectorAll('.dobc-agent text')].map((each) => each.textContent)"
        )
        assert labels == list(long_labels().network.labels)
        # none of them inside its circle, where others do not fit
        assert page.run("document.querySelectorAll('.dobc-beside').length") == len(labels)


def test_an_arc_passes_by_the_agent_between_its_ends(tmp_path: Path):
    network = dd.Network.from_arcs([[2, 1], [3, 2], [4, 3], [4, 1]], arrow="listens_to", agents=4)
    places = [[-1, 0], [0, 0], [1, 0], [1, 1]]
    with shown(dd.Problem(network=network, coupling="y", gains={1: 1}), tmp_path) as page:
        page.run(
            "document.querySelector('.dobc-designer').replaceWith(document.createElement('p'))"
        )
        page.run(f"values.network.places = {places}; values.arcs = {{G: [[2, 0], [1, 0]]}}")
        page.run("document.querySelector('main p').id = 'designer'")
        page.run("render({ model, el: document.getElementById('designer') })")
        far, near = page.run(
            "[...document.querySelectorAll('.dobc-arc')].map((each) => each.getBBox().height)"
        )
        assert far > 15  # the radius of an agent
        assert near < 1


def test_a_gain_is_typed_as_a_number_and_undone_and_redone(page: Page):
    page.run(f"{GAIN}.value = '0.375'; {GAIN}.dispatchEvent(new Event('change'))")
    assert page.run("values.gains") == {"1": 0.375, "6": 5}
    click(page, "Undo")
    assert page.run("values.gains") == {"1": 5, "6": 5}
    click(page, "Redo")
    assert page.run(f"[values.gains['1'], {GAIN}.value]") == [0.375, "0.375"]
    page.run(f"{GAIN}.value = '-1'; {GAIN}.dispatchEvent(new Event('change'))")
    assert page.run(f"{GAIN}.value") == "0.375"
    assert page.run("document.body.textContent.includes('Type a number above 0.')")
    click(page, "Undo")


def test_a_drag_of_a_slider_is_one_step_of_undo(page: Page):
    slider = "document.querySelector('.dobc-gains input[type=range]')"
    for place in (300, 400, 500):
        page.run(f"{slider}.value = {place}; {slider}.dispatchEvent(new Event('input'))")
    page.run(f"{slider}.dispatchEvent(new Event('change'))")
    until("the move", lambda: page.run("values.gains['1']") == pytest.approx(10**0.5, rel=0.01))
    click(page, "Undo")
    until("the gain before", lambda: page.run("values.gains['1']") == 5)


def test_the_mouse_pins_adds_and_removes_arcs(page: Page):
    for kind in ("mousePressed", "mouseReleased"):
        mouse(page, kind, 3)
    assert page.run("values.gains") == {"1": 5, "6": 5, "3": 5}
    for wanted in (11, 10):  # information from 4 to 1, and no more
        mouse(page, "mousePressed", 4)
        mouse(page, "mouseMoved", 1)
        mouse(page, "mouseReleased", 1)
        until("the arcs", lambda wanted=wanted: page.run("values.arcs.Ga.length") == wanted)
        assert page.run("values.arcs.Ga.some(([i, j, w]) => i === 0 && j === 3 && w === '1')") is (
            wanted == 11
        )
        assert page.run("document.querySelectorAll('.dobc-arc').length") == wanted
    counted = "[values.arcs.Ga.length, Object.keys(values.gains).length]"
    for before in ([11, 3], [10, 3], [10, 2]):
        click(page, "Undo")
        until("one step back", lambda before=before: page.run(counted) == before)


def test_arrow_keys_go_from_agent_to_agent_and_enter_pins(page: Page):
    page.run(f"{AGENT.format(1)}.focus()")
    for key in ("ArrowRight", "ArrowRight", "ArrowLeft"):
        press(page, key)
    assert page.run("document.activeElement.dataset.agent") == "2"
    press(page, "Enter")
    assert "2" in page.run("values.gains")
    press(page, "z", modifiers=2)
    until("the pins before", lambda: page.run("values.gains") == {"1": 5, "6": 5})


def test_axes_have_round_ticks_and_units(page: Page):
    ticks = page.run("[...document.querySelectorAll('.dobc-time')].map((each) => each.textContent)")
    assert ticks == ["0", "5", "10", "15", "20"]
    text = page.run("document.body.textContent")
    for words in ("time in s", "in units of x", "1/s", "pinned: knows the target", "not pinned"):
        assert words in text


def test_copy_as_python_shows_what_the_kernel_sends(page: Page):
    click(page, "Copy as Python")
    assert page.run("sent.at(-1).kind") == "python"
    page.run("model.tell('msg:custom', {kind: 'python', text: 'import dobc_design as dd'})")
    assert page.run("document.querySelector('textarea').value") == "import dobc_design as dd"
    if "DOBC_SCREENSHOTS" in os.environ:
        page.screenshot(Path(os.environ["DOBC_SCREENSHOTS"]) / "designer-page.png")


@pytest.mark.skipif(not AXE, reason="needs axe-core: AXE_SCRIPT=/path/to/axe.min.js")
def test_an_audit_by_axe_finds_nothing_in_the_page(page: Page):
    page.run(Path(AXE).read_text("utf-8") + "; true")
    found = page.run(
        "axe.run(document).then((it) => it.violations.map((each) => each.id + ' ' + "
        "each.nodes[0].target))"
    )
    assert found == []

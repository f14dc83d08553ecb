"""Figures: what is drawn where, and that names are never read as mathematics."""

from xml.etree import ElementTree

from dobc_design.plotting import look
from dobc_design.report import figures
from dobc_design.report.document import Picture
from dobc_design.report.pictures import svg_of


def svg_text(draw, *, name, alt):
    return svg_of(Picture(name=name, title="", caption="", alt=alt, draw=draw))


def test_a_figure_is_drawn_once():
    """Matplotlib draws a figure with a layout twice when it is saved."""
    drawn = []

    def draw(ax):
        own = ax.draw
        ax.draw = lambda renderer: (drawn.append(renderer), own(renderer))
        return ax.plot([0, 1], [0, 1])

    assert "<path" in svg_text(draw, name="once", alt="A line.")
    assert len(drawn) == 1


def test_long_series_are_thinned_and_keep_their_ends():
    rows = look.thinned_rows(100_000)
    ends = (len(rows), rows[0], rows[-1])
    expected = (look.MOST_POINTS, 0, 99_999)
    assert ends == expected
    assert look.thinned_rows(3).tolist() == [0, 1, 2]
    shown = look.shown_agents(1000, {500, 700})
    assert len(shown) == look.MOST_AGENTS
    assert {500, 700} <= set(shown)


def test_an_svg_is_xml_with_own_identifiers_variables_and_its_alternative():
    text = svg_text(lambda ax: ax.plot([1, 2], color="#0072b2"), name="one", alt='a "b" <c>')
    root = ElementTree.fromstring(text)
    assert root.get("aria-label") == 'a "b" <c>'
    assert "var(--figure-blue, #0072b2)" in text
    for each in root.iter():
        assert each.get("id", "one-").startswith("one-")
    assert "<style" not in text


def test_names_are_not_read_as_mathematics_and_powers_of_ten_are_written_out():
    text = svg_text(
        lambda ax: figures.plot_lambda(ax, {"$\\frac{$": [-1.0], "<b>": [-2.0]}), name="x", alt="x"
    )
    assert "$\\frac{$" in text
    assert "&lt;b&gt;" in text
    exponents = (-3, -1, 0, 1, 12)
    found = [look.power_of_ten(10.0**k) for k in exponents]
    expected = ["10⁻³", "0.1", "1", "10", "10¹²"]
    assert found == expected

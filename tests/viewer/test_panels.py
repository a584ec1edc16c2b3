"""Texts of panels, the command palette, menus and keys, the lights panel, without a window."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.support.patience import wait_until
from tests.viewer._states import seen
from volspec.appearance.comparison.rendition import light_figures
from volspec.appearance.display.monitors import PRESETS
from volspec.appearance.spec import MODELS
from volspec.relight import LightRig, RelightSpec
from volspec.spectra import DEFAULT_GRID, PAPERS_GRID, light, reflectance
from volspec.spectra.library.catalogue import library_names
from volspec.transfer.presets import histogram
from volspec.viewer.model import light_parts, lights, viewing
from volspec.viewer.model.commands import BY_KEY, BY_NAME, COMMANDS, MENUS, format_key
from volspec.viewer.model.edit import after, with_interface
from volspec.viewer.model.light_rows import MAX_ROWS, effective_weights
from volspec.viewer.model.materials import material_message
from volspec.viewer.model.rendition import chosen_lights, measure
from volspec.viewer.model.state import ViewState
from volspec.viewer.ui import commands, lights_dial, menus, transfer_detail
from volspec.viewer.ui.context import Request, UiContext
from volspec.viewer.ui.light_look import adapted_colour, column_heights, raw_colour
from volspec.viewer.ui.lights_dial import Ring
from volspec.viewer.ui.lights_library import verdict
from volspec.viewer.ui.lights_panel import row_tip
from volspec.viewer.ui.lights_rendition import metamer_lines, number_lines
from volspec.viewer.ui.lights_spectrum import pen_place, wavelength_share
from volspec.viewer.ui.overlays import label_boxes
from volspec.viewer.ui.transfer_plot import bars
from volspec.viewer.ui.viewing import matching_preset, white_text
from volspec.viewer.ui.widgets import pack_colour
from volspec.viewer.work.rendition import RenditionService
from volspec.viewer.work.session_store import RecentFile
from volspec.volume import Volume


def test_swatches_show_tungsten_orange_and_what_adapts_to_it_nearly_white(state):
    tungsten = state.lights[1].rig
    adapted = adapted_colour(tungsten, state.relight)
    assert raw_colour(tungsten)[2] < 0.5 and min(adapted) > 0.85
    assert adapted_colour(tungsten, state.relight) is adapted  # cached
    # Sodium lies outside of sRGB; a swatch is within it, its strongest channel at 1.
    for name in ("A", "HP1", "LPS", "D65", "LED-B1"):
        colour = raw_colour(LightRig((light(name),)))
        assert min(colour) >= 0.0 and max(colour) == pytest.approx(1.0)


def test_a_colour_is_packed_with_its_own_opacity_and_one_more():
    """imgui packs alpha, blue, green, red, the highest byte first."""
    assert pack_colour((1.0, 0.0, 0.2)) == 0xFF3300FF
    assert pack_colour((1.0, 0.0, 0.2, 0.4), 0.5) == 0x333300FF


def test_settings_as_they_are_unknown_or_in_conflict_change_nothing(state):
    by_pixel = viewing.with_viewing(RelightSpec(), adapting="pixel")
    assert viewing.with_model(by_pixel, "Hunt").viewing.adapting == "picture"
    assert viewing.with_viewing(by_pixel, model="Hunt") is by_pixel
    assert viewing.with_viewing(by_pixel, discount=True).viewing.discount
    now = state.relight.viewing
    for edit, *names in (
        (viewing.set_viewing, "model", "adapting", "surround", "exposure"),
        (viewing.set_display, "preset", "space", "gamut", "white_cd_m2"),
        (viewing.set_relight, "mode", "level", "nosuch"),
    ):
        assert all(edit(state, name, "nosuch") is state for name in names)
    assert viewing.set_viewing(state, "model", now.model) is state
    assert viewing.set_display(state, "gamut", now.display.gamut) is state
    assert viewing.set_display(state, "white_cd_m2", -1.0) is state


def test_luminance_follows_the_light_until_it_is_given(state):
    """L_A is E_v/π · Y_b/100, of the light's own lux or the viewing's."""
    for lit, lux in ((light_parts.set_lux(state, 0, 50.0), 50), (state, 1000)):
        own = viewing.toggle_own_luminance(lit)
        np.testing.assert_allclose(own.relight.viewing.L_A, lux / np.pi * 0.2)
    assert viewing.set_viewing(own, "L_A", 5.0).relight.viewing.L_A == 5.0
    assert viewing.toggle_own_luminance(own).relight.viewing == state.relight.viewing
    # A brighter display is adapted to.
    display = state.relight.viewing.display
    brighter = viewing.set_display(state, "white_cd_m2", 3 * display.white_cd_m2)
    np.testing.assert_allclose(brighter.relight.viewing.display.L_A, 3 * display.L_A)


def test_a_room_is_named_until_its_numbers_change():
    for name, each in PRESETS.items():
        display = replace(each.display("Display P3", "reduce"), mark=True)
        assert matching_preset(display) == name
        assert matching_preset(replace(display, Y_b=33.0)) not in PRESETS


def test_the_adopted_white_is_of_what_shines_alone(state):
    # D65 of CIE 15:2004; bands of 10 nm lose the fourth digit.
    assert " 0.312" in white_text(state.lights)
    assert white_text(lights.toggle_mute(state, 0).lights) == white_text(())
    assert white_text(lights.set_weight(state, 1, 1.0).lights) != white_text(state.lights)


def test_values_far_from_zero_are_counted_as_those_near_it():
    """Steps of 1/64 are exact in float32 up to 2^18."""
    near = np.arange(64, dtype=np.float32).reshape(4, 4, 4) / 64
    counts = histogram(Volume(near))
    assert counts.sum() == 64
    np.testing.assert_array_equal(histogram(Volume(near + np.float32(2**17))), counts)
    assert histogram(Volume(1e6 + near)).sum() == 64


@pytest.mark.parametrize("logarithmic", [False, True])
def test_histogram_bars_stay_within_the_plot(logarithmic):
    for counts in (np.zeros(256), np.r_[1e9, np.ones(255)]):
        heights = bars(counts, logarithmic)
        assert np.isfinite(heights).all() and heights.min() >= 0 and heights.max() <= 1


def test_names_and_titles_are_in_one_line(state):
    name = "north\nwindow\t\x07\u202e"
    row = replace(state.lights[0], name=name, label="of\r\nglass")
    words = [line.split(" ") for line in row_tip(row).split("\n")]
    assert words == [["north", "window"], ["of", "glass"]]
    lights = replace(state, lights=(row, *state.lights[1:]))
    (title,) = (row.title for row in commands.list_entries(lights, (), "north alone"))
    assert title.isprintable() and lights.lights[0].name == name


def test_actions_that_do_something_or_have_nothing_to_do_say_nothing(state):
    here = UiContext()
    for name in ("keep-mix", "save-state", "palette-light", "remove-light", "preset-bone"):
        assert here.run(state, BY_NAME[name]) is not state, name
    assert here.run(state, BY_NAME["transfer-points"]) is state and here.requests == []


def test_the_command_palette_says_why_a_light_is_not_added(state):
    command = commands.list_entries(state, (), "add light hp1")[0]
    here, full = UiContext(), replace(state, lights=state.lights[:1] * MAX_ROWS)
    assert here.edited(full, command.change) is full
    assert here.requests == [Request("warning", after(command.change, full).message)]
    assert here.edited(state, command.change) is not state
    assert len(here.requests) == 1


def test_the_library_says_what_adding_a_material_did_or_why_it_did_not(state):
    here = UiContext()
    here.library.search = "silver"
    new = transfer_detail.add_picked_material(state, here, 0, "silver")
    assert "silver" in new.transfer.materials and here.library.search == ""
    assert here.requests[0].argument == material_message(state.transfer, new.transfer)
    here.library.search = "gould"
    assert transfer_detail.add_picked_material(state, here, 0, "gould") is state
    # What was typed stays, to be mended.
    assert "gold" in here.library.complaint and here.library.search == "gould"
    assert len(here.requests) == 1


def test_a_colour_in_progress_is_waited_for(state, monkeypatch):
    unmade = SimpleNamespace(spectra=None)
    monkeypatch.setattr(transfer_detail.css_colours, "colours", lambda *_: unmade)
    here = UiContext()
    assert transfer_detail.add_picked_material(state, here, 0, "tomato") is state
    assert here.library.search == "tomato"
    assert here.requests == [Request("message", here.library.complaint)]


HEAD = "/data/head.nrrd"
RECENT = (RecentFile(HEAD, True), RecentFile("/data/gone.nrrd", False))


def titles(state: ViewState, search: str) -> list[str]:
    return [row.text for row in commands.list_entries(state, RECENT, search)]


def test_the_palette_lists_every_action_light_model_display_and_file(state):
    rows = commands.list_entries(state, RECENT)
    names = {row.text for row in rows}
    for action in COMMANDS:
        title = f"{action.menu or 'Move'}: {action.title.removesuffix(' …')}"
        assert title in names or action.name == "commands"
    for row in state.lights:
        assert any(name.startswith(f"Light: {row.name} alone") for name in names)
    assert {f"Model: {name}" for name in MODELS} <= names
    assert {f"Display: {name}" for name in PRESETS} <= names
    assert [row.request for row in rows if row.group == "Open"] == [Request("open", HEAD)]
    # Each does something, and rows with a key show it.
    assert all((row.change is None) != (row.request is None) for row in rows)
    shots = [row for row in rows if row.request == Request("screenshot")]
    assert [row.key for row in shots] == ["S"]


@pytest.mark.parametrize(
    ("search", "first"),
    [
        ("", "File: Open"),
        ("hp1", "Add light: HP1"),
        ("street", "Add light: HP1"),
        ("fl2 alone", "Light: FL2 alone"),
        ("FL2", "Light: FL2 alone"),
        ("tung", "Light: A alone, tungsten lamp"),
        ("undo", "Edit: Undo"),
        ("exp py", "File: Export as Python"),
        ("svscn", "File: Save as a scene"),
        ("zzzz", ""),
    ],
)
def test_a_search_finds_words_before_letters(state, search, first):
    rows = (state.lights[0], replace(state.lights[1], label="tungsten lamp"), *state.lights[2:])
    title = next(iter(titles(replace(state, lights=rows), search)), "")
    assert title.startswith(first) and bool(title) == bool(first)


# Commands, and the usual names that find them among the first rows.
_USUAL = {
    "Render: Shadows": "shadow",
    "Render: Ambient occlusion": "ambient occlusion",
    "Render: Add a directional light": "light source, direction",
    "Render: Add a sky": "sky",
    "Render: Projection: maximum (MIP)": "MIP, maximum",
    "Render: Projection: average": "average, x-ray",
    "Render: Quality: fast": "quality",
    "Render: Jitter against rings": "jitter",
    "Render: Pre-integration": "pre-integration",
    "Setting: Step": "step",
    "Setting: Shininess": "shininess, highlight",
    "Setting: Specular": "specular",
    "Setting: Backdrop": "background",
    "Setting: Adaptation": "white balance",
    "Setting: Exposure": "exposure, brightness",
    "View: Front": "camera",
    "View: Orthographic": "perspective",
    "View: Scale bar": "scale bar, ruler",
    "View: Measure a distance": "measure, distance",
    "View: Measure an angle": "angle",
    "View: Add a label": "annotate",
    "Move: Zoom in": "zoom",
    "File: Save a film": "film, movie, video, turntable, animation",
    "File: Save a web page": "page, web page, html",
    "File: Save the picture": "screenshot, png",
    "File: Open": "load",
    "Transfer: Kind: Curve": "transparent, opacity",
    "Transfer: The scene's own transfer function": "transfer function",
    "Transfer: Kind: Surfaces": "isosurface",
    "Window: Transfer panel": "segment, label",
    "Window: Slices panel": "slices, axial",
    "Window: Messages panel": "errors",
    "Cut: Crop box": "crop",
    "Cut: Add a clip plane facing you": "clip",
    "Add light: A": "tungsten",
    "Add light: HP1": "sodium, street",
    "Add light: D65": "daylight",
}
_FIRST = ("shadow", "MIP", "jitter", "exposure", "film")  # titles before other names


@pytest.mark.parametrize("title", _USUAL)
def test_usual_names_find_their_command(state, title):
    for search in _USUAL[title].split(", "):
        texts = [row.text for row in commands.list_entries(state, (), search)]
        assert any(text.startswith(title) for text in texts[: 1 if search in _FIRST else 8]), texts


def found(state: ViewState, search: str) -> ViewState:
    """Return the state after the first entry that a search finds."""
    return after(commands.list_entries(state, (), search)[0].change, state).state


def test_rows_do_what_they_say(state):
    # A light that is shown alone is chosen.
    for search, chosen in (("light FL2 alone", 2), ("next light alone", 1), ("add light HP1", 4)):
        new = found(state, search)
        assert new.interface.light == chosen
        assert [i for i, weight in enumerate(effective_weights(new.lights)) if weight] == [chosen]
    assert new.lights[-1].name == "HP1"
    assert found(state, "model CAM16").relight.viewing.model == "CAM16"
    assert found(state, "window dark").interface.dark != state.interface.dark
    assert found(state, "deuteranopia deutan").relight.viewing.deficiency == "deutan"
    assert found(state, "surround dim").relight.viewing.surround == "dim"
    assert found(state, "gamut reduce").relight.viewing.display.gamut == "reduce"
    room = next(name for name, preset in PRESETS.items() if preset.surround == "dark")
    marked = seen(state, display=replace(state.relight.viewing.display, mark=True))
    display = found(marked, f"display {room}").relight.viewing.display
    assert display.surround == "dark" and display.mark


def test_settings_are_reached_by_name(state):
    closed = with_interface(state, panels=frozenset())
    for panel, names in {
        "Viewing": ("Illuminance", "Exposure", "Background", "Room", "Adaptation"),
        "Lighting": ("Shininess", "Specular"),
        "Quality": ("Jitter", "Light cells"),
    }.items():
        for name in names:
            setting = commands.list_entries(state, (), f"setting {name}")[0]
            assert (setting.panel, setting.item) == (panel, name)
            assert panel in after(setting.change, closed).state.interface.panels


def test_keys_are_used_once_and_shown_in_columns_of_even_height():
    used = [key for action in COMMANDS for key in action.keys if key]
    assert len(used) == len(set(used)) == len(BY_KEY)
    # Those of no menu are steps, which only keys make.
    assert {action.menu for action in COMMANDS} <= {*MENUS, ""}
    assert format_key("f1") == "F1" and format_key("ctrl+p") == "Ctrl+P"
    listed = {what for _, rows in menus.SHEET for _, what in rows}
    for action in COMMANDS:
        # Steps by arrows and the recall of states have a line each there.
        if action.menu and not action.name.startswith("recall-"):
            assert not any(action.keys) or action.title.removesuffix(" …") in listed
    for count in (1, 2, 3, 9):
        columns = menus.columns(menus.SHEET, count)
        assert len(columns) <= count
        assert [part for column in columns for part in column] == list(menus.SHEET)
    tall = [sum(len(rows) + 2 for _, rows in column) for column in menus.columns(menus.SHEET, 2)]
    # Parts are not divided, so that one may be left over.
    assert max(tall) - min(tall) <= max(len(rows) + 2 for _, rows in menus.SHEET)


AREA = (0, 20, 900, 600)


@given(at=st.floats(0, 900), left=st.floats(20, 400), right=st.floats(20, 400))
def test_names_of_both_sides_stay_inside_and_apart(at, left, right):
    a, b = label_boxes(AREA, at, (left, right), 20.0, 16.0, 12.0)
    for x, y, width, height in (a, b):
        assert x >= 12 and x + width <= 888 and y >= 20 and height == 20
    side_by_side = a[0] + a[2] <= b[0] or b[0] + b[2] <= a[0]
    assert side_by_side or abs(a[1] - b[1]) >= 20
    # In the upper line they are on their own sides.
    assert a[1] > 36 or a[0] + a[2] <= at
    assert b[1] > 36 or b[0] >= at


def test_the_library_says_what_a_notation_is_or_what_is_wrong_with_it():
    for text in ("D65*0.7+planck:2700*0.3", *library_names()):
        rig, wrong = verdict(text, DEFAULT_GRID, ".")
        assert rig is not None and wrong == "", text
    for text, named in (("D65*0.7+Q*0.3", "'Q'"), ("daylight:62", "62"), ("lamp.csv", "file")):
        rig, wrong = verdict(text, DEFAULT_GRID, ".")
        assert rig is None and named in wrong


def test_columns_of_a_plot_lie_on_the_bands():
    values = np.arange(31.0)
    np.testing.assert_allclose(column_heights(values, 31), values)
    # 15 columns a band: the middle one is the band's.
    np.testing.assert_allclose(column_heights(values, 31 * 15)[7::15], values)
    # The pen on a wavelength's tick is on its band: 550 nm is the 16th of 31.
    share = wavelength_share(550.0, PAPERS_GRID)
    place = pen_place((share * 310.0, 0.0), (0.0, 0.0, 310.0, 50.0), 31, 2.0)
    assert place == pytest.approx((15 / 30, 2.0))


LONG = (
    *("Macbeth daylight", "Tungsten halogen", "HP1 high-pressure sodium"),
    *("FL2", "Candle flame, 1900 K", "D65"),
)


def wide(text: str) -> float:
    """Mean width of the panel's letters."""
    return 6.2 * len(text) + 4


def ring_in(width: float, height: float, most: float, names: Sequence[str] = LONG) -> Ring:
    """Return the dial with names in a panel's area, of radius ``most`` at the most."""
    return lights_dial.ring_for(names, (0.0, 0.0, width, height), (24.0, most), 10.0, 15.0, wide)


@given(
    boxes=st.lists(
        st.tuples(st.floats(-20, 120), st.floats(-20, 120), st.floats(1, 60), st.floats(1, 20)),
        max_size=40,
    )
)
def test_names_at_the_dial_never_overlap(boxes):
    labels = [lights_dial.DialLabel(i, box, float(i)) for i, box in enumerate(boxes)]
    kept = lights_dial.non_overlapping(labels, (0.0, 0.0, 100.0, 100.0))
    for i, one in enumerate(kept):
        x, y, width, height = one.box
        assert x >= 0 and y >= 0 and x + width <= 100 and y + height <= 100
        for other in kept[i + 1 :]:
            left, top, wide, tall = other.box
            assert x + width <= left or left + wide <= x or y + height <= top or top + tall <= y
    inside = [e for e in labels if lights_dial.non_overlapping([e], (0.0, 0.0, 100.0, 100.0))]
    assert not inside or kept[0] == inside[0]


def test_long_names_are_whole_around_a_dial_as_small_as_it_gets():
    """Size that the panel gives it in a window of 900 by 600 pixels."""
    ring = ring_in(250.0, 103.0, 24.5)
    labels = lights_dial.place_labels(LONG, range(6), ring)
    written = {label.index: " ".join(label.lines).replace("- ", "-") for label in labels}
    assert written == dict(enumerate(LONG))
    # The sodium lamp, at the right, has moved the dial to the left.
    assert ring.middle[0] < 125.0 and ring.middle[1] == 51.5


def test_names_at_the_left_end_at_the_dial_and_those_at_the_right_begin_there():
    ring = ring_in(320.0, 200.0, 60.0)
    for label in lights_dial.place_labels(LONG, range(6), ring):
        across = lights.rim_places(6)[label.index][0]
        at = pytest.approx(ring.middle[0] + across * ring.reach)
        starts = lights_dial.line_starts(label, across, wide)
        for start, text in zip(starts, label.lines, strict=True):
            assert across <= 0.5 or start == at
            assert across >= -0.5 or start + wide(text) == at


def test_a_name_that_has_no_room_ends_in_an_ellipsis_and_takes_no_other_s_place():
    crowded = ("D65", "Osram Dulux, warm white", "x" * 40, *LONG)
    ring = ring_in(180.0, 103.0, 24.5, crowded)
    labels = lights_dial.place_labels(crowded, range(9), ring)
    plain = lights_dial.non_overlapping(labels, ring.within)
    assert len(plain) == len(labels) and any(label.lines[0].endswith("…") for label in labels)
    assert labels[0].lines == ("D65",)


def test_the_dial_is_smaller_for_long_names_and_stays_where_they_are_short():
    short, long = (ring_in(330.0, 300.0, 105.0, names) for names in (("D65", "A", "FL2"), LONG))
    assert short.radius == 105.0 and short.middle == (165.0, 150.0)
    assert 63.0 <= long.radius < 105.0
    assert sum(lights_dial.extents(LONG, long.radius + 10.0, wide)) <= 330.0


def test_a_light_is_found_at_the_rim_and_by_its_name():
    ring = ring_in(330.0, 300.0, 105.0)
    labels = lights_dial.place_labels(LONG, range(6), ring)
    x, y, width, height = next(label for label in labels if label.index == 2).box
    assert lights_dial.label_at(labels, x + width / 2, y + height / 2) == 2
    assert lights_dial.label_at(labels, *ring.middle) == -1
    for x, y, found in ((0.05, -1.0, 0), (1.0, 0.02, 1), (0.0, 0.0, -1)):
        assert lights_dial.light_at(4, x, y, 0.1) == found


def test_rendition_is_that_of_the_light_s_notation_over_the_whole_visible(state):
    """The figures of a light by its name do not depend on the document's bands."""
    state = lights.add(state, text="FL2").state
    at = len(state.lights) - 1
    found = measure(chosen_lights(lights.choose(state, at), False))
    assert number_lines(found) == [
        *("R_f 70   R_g 86", "R_a 64   R_9 -84", "SSI 62, daylight:4225"),
        *("4225 K, Duv +0.0019", "337 lm/W"),
    ]
    # Once drawn, it has the document's bands only, and lines of their width.
    drawn = light_parts.draw(lights.choose(state, at), at, 0, (0.1, 0.5), (0.1, 0.5))
    other = measure(chosen_lights(drawn, False))
    assert 0.05 < abs(other.light.rendition.R_f - found.light.rendition.R_f) < 20


def test_rendition_of_the_mix_counts_what_shines(state):
    for text in ("FL2", "FL12"):
        state = lights.add(state, text=text).state
    last = len(state.lights) - 1
    alone = lights.only(state, last)
    whole, single = (measure(chosen_lights(alone, whole)) for whole in (True, False))
    assert whole.light.lm_per_W == pytest.approx(single.light.lm_per_W)
    mix = lights.set_weight(lights.set_weight(alone, last, 0.5), last - 1, 0.5)
    mixed = light_figures(lambda grid: light("FL2*0.5+FL12*0.5", grid))
    found = measure(chosen_lights(mix, True)).light.rendition
    assert found.R_f == pytest.approx(mixed.rendition.R_f)
    assert chosen_lights(lights.set_weight(alone, last, 0.0), True) is None


def test_materials_alike_in_daylight_are_named_with_what_parts_them(state):
    """The engine's block and inserts are a metameric pair, designed on the document's bands."""
    data = Path(__file__).resolve().parents[2] / "data" / "spectra"
    files = {name: str(data / f"engine-{name}.csv") for name in ("block", "inserts")}
    engine = tuple((n, reflectance(file)) for n, file in ({"copper": "copper"} | files).items())
    state = lights.add(state, text="A").state
    tungsten = chosen_lights(lights.choose(state, len(state.lights) - 1), False)
    found = measure(tungsten._replace(materials=engine))
    assert found.pair == ("block", "inserts") and found.metamerism.delta_E < 1
    assert found.metamerism.illuminant > 15
    first, second, third = metamer_lines(found)
    assert first.startswith("block and inserts: ΔE 0.") and second.startswith("ΔE 2")
    assert third.count("CIE 2015") == 2
    plain = measure(tungsten._replace(materials=engine[:2]))
    assert plain.pair is None and metamer_lines(plain) == []


def test_lights_are_measured_in_the_background_once_for_each_change(state):
    service = RenditionService(lambda: None)
    first = chosen_lights(state, False)
    for _ in range(3):
        service.follow(first)
    wait_until(service.take)
    wait_until(lambda: not service.busy)
    assert service.latest[0] == first and not service.take()
    service.follow(chosen_lights(state, False))
    assert not service.busy, "the same lights again"
    service.follow(chosen_lights(lights.choose(state, 1), False))
    assert service.busy
    service.close()

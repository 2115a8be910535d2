# SPDX-License-Identifier: Apache-2.0
"""Everything written on the page can be read, in light and dark: WCAG's ratio of 4.5."""

from __future__ import annotations

import numpy as np
import pytest

from cartoloop.map_output.colours import DARK, LIGHT, MIN_CONTRAST, MIN_TEXT_CONTRAST, contrast
from tests.localisation.rooms import BOX, START
from tests.viewer.locating import go, locating
from tests.viewer.real_page import opened

TEXTS = """() => {
    // Colours behind an element, the nearest first, until one that hides what is behind it.
    const parse = (text) => (text.match(/[\\d.]+/g) ?? [0, 0, 0, 0]).map(Number);
    const behind = (element) => {
        const found = [];
        for (let at = element; at; at = at.parentElement) {
            const colour = parse(getComputedStyle(at).backgroundColor);
            if ((colour[3] ?? 1) > 0) found.push(colour);
            if ((colour[3] ?? 1) === 1) break;
        }
        return found;
    };
    const seen = (element) => {
        const { visibility, opacity } = getComputedStyle(element);
        const box = element.getBoundingClientRect();
        return box.width > 1 && box.height > 1 && visibility === "visible" && Number(opacity) > 0;
    };
    const found = [];
    for (const element of document.body.querySelectorAll("*")) {
        const own = [...element.childNodes].filter((node) => node.nodeType === 3);
        const text = own.map((node) => node.textContent.trim()).join(" ").trim()
            || (element instanceof HTMLInputElement ? element.placeholder : "");
        if (text === "" || !seen(element) || element.closest("noscript, .unseen")) continue;
        const drawn = element instanceof SVGElement;
        const part = element instanceof HTMLInputElement ? "::placeholder" : null;
        const style = getComputedStyle(element, part);
        const plate = drawn ? element.previousElementSibling : null;
        found.push({
            text, colour: parse(drawn ? style.fill : style.color),
            behind: plate ? [parse(getComputedStyle(plate).fill)] : behind(element),
            isOpaque: !drawn || plate !== null,
        });
    }
    return found;
}"""


def shown(page):
    """Return the texts in sight, with their contrast."""
    found = []
    for text in page.page.evaluate(TEXTS):
        layers = text["behind"]
        assert layers and len(layers[-1]) == 3 and text["isOpaque"], f"{text}: nothing is behind it"
        ground = np.array(layers[-1][:3])
        for *colour, alpha in reversed(layers[:-1]):
            ground = alpha * np.array(colour) + (1.0 - alpha) * ground
        *colour, alpha = (*text["colour"], 1.0)[:4]
        ink = alpha * np.array(colour) + (1.0 - alpha) * ground
        behind = tuple(np.rint(ground).astype(int).tolist())
        found.append((contrast(tuple(np.rint(ink).astype(int).tolist()), behind), text["text"]))
    return found


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_all_text_can_be_read(chromium, server, theme):
    with opened(chromium, server.url) as page:
        page.settle()
        keys = page.page.keyboard
        if theme == "dark":
            keys.press("d")
            page.settle("s.theme === 'dark'")
        texts = shown(page)
        for key in ("l", "s", "m"):
            keys.press(key)
            if key == "m":
                page.page.mouse.click(500, 400)
                page.page.mouse.click(600, 420)
                page.settle("s.measures.length > 0")
            texts += shown(page)
            keys.press("Escape")
        keys.press("g")
        page.page.mouse.move(640, 300)
        keys.press("t")
        page.page.locator("#closures-rows tr[data-row]").first.click()
        page.settle("s.closure !== null")
        texts += shown(page)
        keys.press("Escape")
        keys.press("b")
        page.settle("s.before")
        texts += shown(page)
        keys.press("?")
        texts += shown(page)

    words = " ".join(text for _, text in texts)
    for expected in (
        "finished",
        "extent",
        "Start",
        "grid",
        "by tape",
        "fate",
        "Threshold",
        "close",
    ):
        assert expected in words
    assert [(round(ratio, 2), text) for ratio, text in texts if ratio < MIN_TEXT_CONTRAST] == []


@pytest.mark.parametrize("theme", ["light", "dark"])
@pytest.mark.parametrize("size", [(1280, 800), (390, 800)])
def test_all_text_of_a_localisation_can_be_read(chromium, theme, size):
    texts = []
    with locating(BOX, START) as one, opened(chromium, one.url, size) as page:
        page.settle()
        keys = page.page.keyboard
        if theme == "dark":
            keys.press("d")
            page.settle("s.theme === 'dark'")
        texts += shown(page)
        go(one, page, 5)
        texts += shown(page)
        page.page.click("#pose-button")
        page.page.fill("#pose-x", "")
        page.page.click("#pose-give")
        texts += shown(page)
        for name, value in zip(("x", "y", "heading"), ("2", "5", "77"), strict=True):
            page.page.fill(f"#pose-{name}", value)
        page.page.click("#pose-give")
        page.page.get_by_text("tried at the next scan").wait_for()
        page.wait("s.localisation.given?.number === 1")
        texts += shown(page)
        go(one, page, 2)
        page.page.get_by_text("not believed").wait_for()
        texts += shown(page)
        keys.press("Escape")
        one.localizer.set_pose(one.pose)
        go(one, page, 2)
        one.view.finished()
        page.settle("s.readings.state === 'finished'")
        texts += shown(page)
        keys.press("?")
        texts += shown(page)

    words = " ".join(text for _, text in texts)
    for expected in ("places fit", "%", "Heading", "three numbers", "searching", "ended", "usual"):
        assert expected in words
    assert [(round(ratio, 2), text) for ratio, text in texts if ratio < MIN_TEXT_CONTRAST] == []


@pytest.mark.parametrize(("theme", "colours"), [("light", LIGHT), ("dark", DARK)])
def test_free_and_unknown_differ_on_the_screen(chromium, server, theme, colours):
    with opened(chromium, server.url) as page:
        page.settle()
        if theme == "dark":
            page.page.keyboard.press("d")
            page.settle("s.theme === 'dark'")
        page.layers(trajectory=False, suspects=False, ends=False, scan=False)
        page.look(4.0, 0.5, 60.0)
        floor = tuple(page.pixels()[400, 640].tolist())
        page.look(1000.0, 1000.0, 60.0)
        unknown = tuple(page.pixels()[400, 640].tolist())

        assert unknown == colours.ground
        assert max(abs(a - b) for a, b in zip(floor, colours.floor, strict=True)) <= 2
        assert contrast(floor, unknown) >= MIN_CONTRAST
        behind = page.page.evaluate("getComputedStyle(document.body).backgroundColor")
        assert behind == f"rgb{colours.ground}"

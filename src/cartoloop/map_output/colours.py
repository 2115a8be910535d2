# SPDX-License-Identifier: Apache-2.0
"""Colours of maps, for pictures and for the view, and how well two of them can be distinguished."""

from __future__ import annotations

from typing import NamedTuple

from cartoloop.quality.verdict import Severity

Colour = tuple[int, int, int]


class MapColours(NamedTuple):
    """Colours of a map.

    Attributes
    ----------
    ground : of what is unknown, and around the map.
    floor : of what is surely free.
    wall : of what is surely occupied.
    """

    ground: Colour
    floor: Colour
    wall: Colour


LIGHT = MapColours(ground=(202, 204, 207), floor=(255, 255, 255), wall=(27, 31, 37))
DARK = MapColours(ground=(18, 20, 24), floor=(66, 74, 84), wall=(244, 240, 230))

MIN_CONTRAST = 1.6
"""Of free and unknown: less is not seen on a poor screen or on paper."""

MIN_TEXT_CONTRAST = 4.5
"""Of text and what is behind it: level AA of the Web Content Accessibility Guidelines."""

INK: Colour = (48, 52, 58)
"""Of text on the light ground."""

# Of the palette of Okabe and Ito, which people with any colour vision can distinguish.
TRAJECTORY_COLOUR: Colour = (0, 114, 178)
CLOSURE_COLOUR: Colour = (213, 94, 0)
PLACE_COLOURS: dict[Severity, Colour] = {
    Severity.DOUBTFUL: (230, 159, 0),
    Severity.WRONG: (204, 51, 119),
}
"""Places of minor severity are not drawn."""

APPEARED_COLOUR: Colour = (213, 94, 0)
DISAPPEARED_COLOUR: Colour = (0, 114, 178)
"""Of what stands in a place now and of what is gone: vermilion and blue, of the same palette."""


def contrast(first: Colour, second: Colour) -> float:
    """Return the contrast ratio of two colours, 1 to 21, as WCAG 2 defines it."""
    lights = sorted((_luminance(first), _luminance(second)))
    return (lights[1] + 0.05) / (lights[0] + 0.05)


def text_colour(behind: Colour) -> Colour:
    """Return black or white, whichever is read better on a colour."""
    black, white = (0, 0, 0), (255, 255, 255)
    return max((black, white), key=lambda colour: contrast(colour, behind))


def _luminance(colour: Colour) -> float:
    """Return the relative luminance of a colour of sRGB."""
    shares = (value / 255.0 for value in colour)
    linear = [s / 12.92 if s <= 0.04045 else ((s + 0.055) / 1.055) ** 2.4 for s in shares]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

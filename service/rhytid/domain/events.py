"""Single features of facial skin: bumps, papules, scars, milia, moles and wide pores.

An event is a node of the graph whose `node_kind` is above 0: the number of its kind in EVENTS,
counted from 1. How many there are by region and age, and how large: docs/skin.md says what is known
and what is by eye.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rhytid.domain.skin import REGIONS, WHOLE_FACE, wear

# Depths of a wrinkle of strength 1 in the height of an event of weight 1.
EVENT_DEPTHS = 16.0


@dataclass(frozen=True)
class Event:
    """A kind of event. Lengths are in millimetres, pairs are the least and the most.

    radius: of the rim, where the profile ends.  steepness: the height of the middle over the
    radius, below 0 for a pit: what is smaller is lower.
    longer: the most that it is longer than wide.  plateau: whether its profile is (1 - t⁴)², flat
    with a soft rim, in place of the dome (1 - t²)².  rim: b of the factor 1 - b t² of the profile;
    above 1 a pit has a wall around it.  response: share of the log stretch of its place that it
    answers to.  fading: how far lines and pores over its middle fade, from 0 to 1.  patched: power
    of what patches make of its height.  groups: length over which it comes in groups; 0 for no
    groups.  rates: events per cm² at 35 by region.  old:
    factor of the rates at 65; at other ages its power, as `wear` has it.
    """

    radius: tuple[float, float]
    steepness: tuple[float, float]
    longer: float = 1.3
    plateau: bool = False
    rim: float = 0.0
    response: float = 0.5
    fading: float = 0.0
    patched: float = 0.0
    groups: float = 0.0
    old: float = 1.0
    rates: Mapping[str, float] = field(default_factory=dict)

    def rate(self, region: str, age: float) -> float:
        """Events per cm² of a region at an age; regions that are not named are as the face."""
        usual = self.rates.get(region, self.rates.get(WHOLE_FACE, 0.0))
        return float(usual * self.old ** wear(age))

    def rates_at(self, age: float) -> dict[str, float]:
        """`rate` of every region."""
        return {region: self.rate(region, age) for region in REGIONS}


EVENTS: dict[str, Event] = {
    # The mouth of a hair follicle with a plug: in loose groups where beards and vellus grow.
    "bump": Event(
        radius=(0.35, 0.8),
        steepness=(0.08, 0.14),
        patched=1.0,
        groups=9.0,
        rates={
            WHOLE_FACE: 1.2, "forehead": 2.0, "cheek": 1.4, "nose": 0.2, "lip": 0.0,
            "eye_corner": 0.1, "neck": 2.0, "mouth": 1.2,
        },
    ),
    # Low and broad, most of the young.
    "papule": Event(
        radius=(0.8, 2.0),
        steepness=(0.025, 0.05),
        longer=1.5,
        response=0.35,
        fading=0.4,
        patched=0.5,
        old=0.4,
        rates={
            WHOLE_FACE: 0.025, "forehead": 0.03, "cheek": 0.03, "nose": 0.01, "lip": 0.0,
            "eye_corner": 0.0, "neck": 0.9,
        },
    ),
    # Of acne or chickenpox: a pit with a faint wall.
    "scar": Event(
        radius=(0.7, 1.8),
        steepness=(-0.08, -0.045),
        longer=2.5,
        rim=2.2,
        response=0.25,
        fading=0.6,
        rates={
            WHOLE_FACE: 0.008, "forehead": 0.012, "cheek": 0.035, "nose": 0.01, "lip": 0.0,
            "eye_corner": 0.0, "neck": 0.004,
        },
    ),
    # A hard cyst of keratin under thin skin.
    "milium": Event(
        radius=(0.35, 0.7),
        steepness=(0.12, 0.2),
        longer=1.1,
        response=0.25,
        fading=0.6,
        rates={
            WHOLE_FACE: 0.002, "forehead": 0.002, "cheek": 0.012, "nose": 0.005, "lip": 0.0,
            "eye_corner": 0.12, "neck": 0.0,
        },
    ),
    "mole": Event(
        radius=(1.0, 2.4),
        steepness=(0.09, 0.16),
        longer=1.35,
        plateau=True,
        response=0.25,
        fading=0.6,
        old=1.2,
        rates={
            WHOLE_FACE: 0.004, "forehead": 0.003, "cheek": 0.008, "nose": 0.003, "lip": 0.0,
            "eye_corner": 0.0, "neck": 0.025,
        },
    ),
    # Dilated pores, in clusters at the wing and the tip of the nose.
    "wide_pore": Event(
        radius=(0.22, 0.45),
        steepness=(-0.28, -0.15),
        rim=1.15,
        response=1.0,
        groups=5.0,
        old=1.3,
        rates={
            WHOLE_FACE: 0.03, "forehead": 0.1, "cheek": 0.3, "nose": 4.0, "lip": 0.0,
            "eye_corner": 0.0, "neck": 0.0,
        },
    ),
}  # fmt: skip
EVENT_NAMES, KINDS = tuple(EVENTS), tuple(EVENTS.values())
# What `node_kind` is at most.
MOST_KIND = len(EVENTS)
# By `node_kind`; a pore, which is none, has 0 throughout. FORMS: plateau and rim.
FORMS = np.array([(0.0, 0.0), *((float(e.plateau), e.rim) for e in KINDS)], np.float32)
ANSWERS = np.array([0.0, *(event.response for event in KINDS)], np.float32)
SIGNS = np.array([0.0, *(np.sign(event.steepness[0]) for event in KINDS)], np.float32)
FADING = np.array([0.0, *(event.fading for event in KINDS)])

"""Warnings about settings: changed since the content was first sent, or unused."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from rhytid.domain.asset_settings import AssetSettings, BinSettings
from rhytid.domain.lengths import Lengths
from rhytid.domain.setting_fields import leaves, nested
from rhytid.domain.warnings import SETTINGS_CHANGED, SETTINGS_UNUSED, InputWarning
from rhytid.domain.wording import plural

# What can change without synthesising or looking up anything again.
CHANGEABLE = ("depth", "angles", "response", "shape", "preset", "bins", "convolve", "name")
# Settings that are listed one by one.
_LISTED = 6
_R_MAX = "bins.r_max"
# Of `graph`, what is read where the graph is given: of the lengths and of the grain.
READ_OF_GIVEN = ("spacing", "seed")


def settings_changed(
    asset: str, present: AssetSettings, sent: AssetSettings, lengths: Lengths
) -> tuple[InputWarning, ...]:
    """A warning where an asset's settings differ from those that were sent for it now, with the
    PATCH that makes it as sent; empty where they agree.

    lengths: resolve the settings of both that are null. A `bins.r_max` that was sent with its
    default is left to calibrations and not reported.
    """
    wanted, raw = leaves(sent.with_lengths(lengths).drawn()), leaves(sent.drawn())
    now = leaves(present.with_lengths(lengths).drawn())
    calibrated = raw[_R_MAX] == BinSettings().r_max
    if calibrated and now[_R_MAX] <= sent.response.log_stretch_limit:
        wanted[_R_MAX] = now[_R_MAX]
    # Others are what the asset was made by: where they differ, `graph.lines`, it is in name alone.
    differ = [
        name
        for name, value in wanted.items()
        if name.partition(".")[0] in CHANGEABLE and now[name] != value
    ]
    if not differ:
        return ()
    reset = dict.fromkeys(differ)
    if "preset" in reset:
        reset |= dict.fromkeys(_beside_preset(sent.preset, raw))
    listed = [
        f"{name} is {_json(now[name])}, sent was {_json(raw[name])}" for name in differ[:_LISTED]
    ]
    if len(differ) > _LISTED:
        listed.append(f"and {plural(len(differ) - _LISTED, 'setting')} more")
    detail = (
        f"this content was sent before, and its settings were changed since: {'; '.join(listed)}. "
        "They stay as they are now. To have them as sent, PATCH "
        f"/v1/assets/{asset} with {_json(nested({name: raw[name] for name in reset}))}"
    )
    return (InputWarning(SETTINGS_CHANGED, detail, f"asset {asset}"),)


def settings_unused(settings: AssetSettings) -> tuple[InputWarning, ...]:
    """A warning where settings of the synthesis were sent together with a graph or a scan."""
    usual = asdict(AssetSettings.parse({"preset": settings.preset}).graph)
    given = asdict(settings.graph).items()
    unread = {n: v for n, v in given if v != usual[n] and n not in READ_OF_GIVEN}
    if not unread:
        return ()
    listed = ", ".join(f"graph.{name} ({_json(value)})" for name, value in unread.items())
    detail = (
        f"{listed}: these settings say how skin is grown, but a graph or a scan was given "
        "(options --graph and --scan, parts graph and scan): no skin is grown, so they change "
        "nothing. Leave them out, or send neither"
    )
    return (InputWarning(SETTINGS_UNUSED, detail, "settings"),)


def _beside_preset(name: str, raw: dict[str, Any]) -> list[str]:
    """The settings that a preset would set to other values than were sent."""
    usual = leaves(AssetSettings.parse({"preset": name}).as_json())
    groups = ("bins.", "response.", "shape.")
    return [
        n for n, value in raw.items() if n.startswith(groups) and value != usual[n] and n != _R_MAX
    ]


def _json(value: Any) -> str:
    return json.dumps(value)

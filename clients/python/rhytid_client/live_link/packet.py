"""Packets of Live Link Face: one face of one moment, over UDP.

All numbers are big-endian: version (1 byte), device id and subject name (each its length as int32,
then UTF-8), frame number (int32), share of a frame (float32), frames per second as numerator and
denominator (int32 each), count (1 byte), and as many float32.
"""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass

VERSION = 6
# The 52 blendshapes of ARKit in the order of the packets; turns of head and eyes come after.
ARKIT = (
    *("eyeBlinkLeft", "eyeLookDownLeft", "eyeLookInLeft", "eyeLookOutLeft", "eyeLookUpLeft"),
    *("eyeSquintLeft", "eyeWideLeft"),
    *("eyeBlinkRight", "eyeLookDownRight", "eyeLookInRight", "eyeLookOutRight"),
    *("eyeLookUpRight", "eyeSquintRight", "eyeWideRight"),
    *("jawForward", "jawLeft", "jawRight", "jawOpen"),
    *("mouthClose", "mouthFunnel", "mouthPucker", "mouthLeft", "mouthRight"),
    *("mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight"),
    *("mouthDimpleLeft", "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight"),
    *("mouthRollLower", "mouthRollUpper", "mouthShrugLower", "mouthShrugUpper"),
    *("mouthPressLeft", "mouthPressRight", "mouthLowerDownLeft", "mouthLowerDownRight"),
    *("mouthUpperUpLeft", "mouthUpperUpRight"),
    *("browDownLeft", "browDownRight", "browInnerUp", "browOuterUpLeft", "browOuterUpRight"),
    *("cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft", "noseSneerRight"),
    "tongueOut",
)
TURNS = (
    *("headYaw", "headPitch", "headRoll"),
    *("leftEyeYaw", "leftEyePitch", "leftEyeRoll", "rightEyeYaw", "rightEyePitch", "rightEyeRoll"),
)
_COUNT = len(ARKIT) + len(TURNS)
_LENGTH, _TIME = struct.Struct(">i"), struct.Struct(">ifii")
_VALUES = struct.Struct(f">{_COUNT}f")
_LONGEST_NAME = 256


@dataclass(frozen=True)
class FaceFrame:
    """One packet.

    device, subject: whose face.  frame: its number, with the share of a frame.  rate: frames per
    second, 0 where the packet has none.  weights: 52, in the order of ARKIT.  turns: of head and
    eyes, in the order of TURNS.
    """

    device: str
    subject: str
    frame: float
    rate: float
    weights: tuple[float, ...]
    turns: tuple[float, ...]


def read_packet(packet: bytes) -> FaceFrame | None:
    """The face of a packet; None where it says that there is none in the picture.

    Raises ValueError naming what is not as in Live Link Face.
    """
    if not packet or packet[0] != VERSION:
        found = packet[0] if packet else "missing"
        raise ValueError(f"the version is {found}, not {VERSION}")
    device, at = _text(packet, 1, "device id")
    subject, at = _text(packet, at, "subject name")
    if len(packet) < at + _TIME.size:
        raise ValueError(f"{len(packet)} bytes: the time of the frame is cut off")
    number, share, numerator, denominator = _TIME.unpack_from(packet, at)
    at += _TIME.size
    if len(packet) <= at or packet[at] == 0:
        return None
    if packet[at] != _COUNT:
        raise ValueError(f"{packet[at]} values: must be {_COUNT}")
    if len(packet) != at + 1 + _VALUES.size:
        raise ValueError(f"{len(packet)} bytes: {_COUNT} values end at {at + 1 + _VALUES.size}")
    values = _VALUES.unpack_from(packet, at + 1)
    if not all(map(math.isfinite, values)):
        raise ValueError("a value is not finite")
    rate = numerator / denominator if denominator > 0 and numerator > 0 else 0.0
    share = share if 0.0 <= share < 1.0 else 0.0
    weights, turns = values[: len(ARKIT)], values[len(ARKIT) :]
    return FaceFrame(device, subject, number + share, rate, weights, turns)


def _text(packet: bytes, at: int, what: str) -> tuple[str, int]:
    """A text and where it ends; some senders count a zero byte at its end."""
    if len(packet) < at + _LENGTH.size:
        raise ValueError(f"{len(packet)} bytes: the {what} is cut off")
    (length,) = _LENGTH.unpack_from(packet, at)
    start, end = at + _LENGTH.size, at + _LENGTH.size + length
    if not 0 <= length <= _LONGEST_NAME or end > len(packet):
        raise ValueError(f"the {what} has a length of {length}")
    try:
        return packet[start:end].rstrip(b"\0").decode(), end
    except UnicodeDecodeError as exc:
        raise ValueError(f"the {what} is not UTF-8") from exc

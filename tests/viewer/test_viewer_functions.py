"""Functions of the viewer that need no page, in Node."""

from __future__ import annotations

import json
import subprocess
from typing import Any

from house.syntax import ROOT

VIEWER = ROOT / "clients" / "viewer" / "rhytid_viewer"


def run(module: str, names: str, body: str) -> Any:
    """What `body`, the inside of an async function, gives with functions of a module."""
    source = f"import {{ {names} }} from {json.dumps((VIEWER / module).as_uri())};\n"
    source += f"console.log(JSON.stringify(await (async () => {{ {body} }})()));"
    command = ["node", "--input-type=module", "-e", source]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


def test_the_address_keeps_shapes_of_any_name() -> None:
    body = """
    const names = ["constructor", "__proto__", "a,b:c", "100%2C", "plain"];
    const weights = Object.fromEntries(names.map((name, i) => [name, 0.1 * (i + 1)]));
    const state = { method: "fast", strength: 1, colours: "skin", axes: false, split: null };
    const text = written({ ...state, asset: null, light: [1, 0, 0], weights }, null);
    return [Object.entries(read(text).state.weights), text];"""
    found, text = run("app/address.js", "read, written", body)

    names = ["constructor", "__proto__", "a,b:c", "100%2C", "plain"]
    assert [name for name, _ in found] == names
    assert [round(value, 6) for _, value in found] == [0.1, 0.2, 0.3, 0.4, 0.5]
    assert "plain:0.5" in text


def test_a_shape_without_a_weight_is_at_rest_whatever_its_name() -> None:
    body = 'return [weightOf({}, "constructor"), weightOf({ a: 0.5 }, "a")];'
    assert run("app/state.js", "weightOf", body) == [0, 0.5]


def test_clips_move_shapes_of_any_name() -> None:
    body = """
    const poses = [{ constructor: 0.5, smile: 1 }, { smile: 1 }];
    const clip = await readClip(new File([JSON.stringify(poses)], "a.json"), ["constructor"]);
    return [0, 1 / 30].map((at) => sampler(clip, ["constructor", "toString"])(at));"""
    assert run("app/clip.js", "readClip, sampler", body) == [{"constructor": 0.5}, {}]


def test_a_dropped_file_that_cannot_be_read_is_named() -> None:
    body = """
    return purposeOf(new File(["no archive"], "broken.npz")).catch((error) => error.message);"""
    assert run("app/dropped.js", "purposeOf", body).startswith("broken.npz: ")


def test_what_may_pass_is_asked_again_and_nothing_else() -> None:
    body = """
    globalThis.setTimeout = (run) => queueMicrotask(run);
    const asked = async (error) => {
      let count = 0;
      const ask = async () => { count += 1; if (count < 3) throw error; return "there"; };
      return [await patiently(ask).catch((failed) => failed.message), count];
    };
    return Promise.all([new Refused(503, "busy"), new TypeError("not reached"),
      new Refused(404, "none")].map(asked));"""
    found = run("app/retry.js", "Refused, patiently", body)
    assert found == [["there", 3], ["there", 3], ["none", 1]]


def test_texts_that_no_header_takes_are_no_keys() -> None:
    body = 'return ["rhytid_aZ-9", "ключ", "a b", ""].map(isKey);'
    assert run("app/service.js", "isKey", body) == [True, False, False, False]

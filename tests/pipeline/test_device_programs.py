"""What a device compiles, and how often."""

from __future__ import annotations

from rhytid.device import trial
from rhytid.device.runtime import Device


def test_a_program_is_compiled_once_for_its_kernels_and_anew_for_other_defines(device, monkeypatch):
    own, compile_program, options = Device(device.info, 1 << 20), trial.compile_program, []

    def counted(context, text, given):
        options.append(given[1:])
        return compile_program(context, text, given)

    monkeypatch.setattr(trial, "compile_program", counted)
    for defines in ({}, {"OTHER": 1}, {}):
        for name in ("count_triangles", "list_triangles"):
            kernel = own.programs.kernel("vectors", name, defines)
            assert kernel.function_name == name
            assert own.programs.kernel("vectors", name, defines) is kernel
    assert options == [[], ["-DOTHER=1"]]

"""What a device compiles, and how often."""

from __future__ import annotations

from pyopencl import cache

from rhytid.device import trial
from rhytid.device.caches import provide_cache_folder
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


def test_a_cache_that_fails_costs_a_compilation_alone(device, monkeypatch):
    """As beside other processes: pyopencl raised a KeyError, and a build failed by it."""
    failed = []

    def broken(*arguments, **named):
        failed.append(arguments)
        raise OSError("the file of the cache is locked")

    # It is used where a driver has no cache of its own.
    monkeypatch.setattr("pyopencl._PYOPENCL_NO_CACHE", False)
    monkeypatch.setattr("pyopencl.characterize.has_src_build_cache", lambda device: False)
    monkeypatch.setattr(cache, "_create_built_program_from_source_cached", broken)
    monkeypatch.delenv("PYOPENCL_CACHE_FAILURE_FATAL", raising=False)
    provide_cache_folder()
    own = Device(device.info, 1 << 20)
    text = "kernel void nothing(global int *out) { out[0] = 1; }"
    assert trial.compile_program(own.context, text, []) is not None
    assert failed

"""What the OpenCL driver is told before it is loaded, what it compiles, and how often."""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from pyopencl import cache

import rhytid_kernels
from rhytid.device import caches, driver, loader
from rhytid.device.caches import provide_cache_folder
from rhytid.device.driver import cl
from rhytid.device.runtime import Device
from rhytid.errors import KernelBuildError


def test_a_program_is_compiled_once_for_its_kernels_and_anew_for_other_defines(
    device, compilations
):
    own = Device(device.info, 1 << 20)
    for defines in ({}, {"OTHER": 1}, {}):
        for name in ("count_triangles", "list_triangles"):
            kernel = own.programs.kernel("vectors", name, defines)
            assert kernel.function_name == name
            assert own.programs.kernel("vectors", name, defines) is kernel
    assert [given[1:] for given in compilations] == [[], ["-DOTHER=1"]]


def test_pocl_reads_no_header_of_opencl(device, driver_builds):
    text = "kernel void root(global float *out) { out[0] = sqrt(out[0]); }"
    driver.compile_program(device.context, text, ["-DROOT"])
    own = [driver.HEADER_READ] if device.info.platform == driver.POCL else []
    assert driver_builds == [["-DROOT", *own]]


def test_what_kernels_do_not_use_of_opencl_builds_as_well(device, driver_builds):
    text = "kernel void far(global float *out) { out[0] = hypot(out[0], 1.0f); }"
    assert (
        driver.compile_program(device.context, text, ["-DFAR"]).get_info(
            cl.program_info.KERNEL_NAMES
        )
        == "far"
    )
    assert driver_builds[-1] == ["-DFAR"]


def test_kernels_define_no_macro_of_the_builtins():
    """PoCL would warn of it, and build such a program twice where warnings are errors."""
    macro = re.compile(r"^[ \t]*#[ \t]*define[ \t]+(\w+)", re.MULTILINE)
    taken = set(macro.findall(rhytid_kernels.builtins()))
    for name in rhytid_kernels.names():
        assert not taken & set(macro.findall(rhytid_kernels.source(name))), name


def test_small_numbers_end_where_they_do_by_the_header(device):
    text = """kernel void ended(global short *out, global uchar *bytes) {
        out[0] = add_sat(out[0], out[1]);
        bytes[0] = sub_sat(bytes[0], bytes[1]);
        bytes[1] = clz(bytes[1]);
    }"""
    program = driver.compile_program(device.context, text, [])
    shorts, small = np.array([300, 32700], np.int16), np.array([3, 5], np.uint8)
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    out, there = (cl.Buffer(device.context, flags, hostbuf=values) for values in (shorts, small))
    queue = cl.CommandQueue(device.context)
    program.ended(queue, (1,), None, out, there)
    cl.enqueue_copy(queue, shorts, out)
    cl.enqueue_copy(queue, small, there)
    assert (shorts[0], *small) == (32767, 0, 5)


@pytest.mark.parametrize("lanes", [8, 16])
@pytest.mark.parametrize("name", ["char", "short", "int", "float"])
def test_vectors_are_stored_whole_at_any_address(device, name, lanes):
    text = f"""kernel void moved(
        global const {name} *from, global {name} *out, local {name} *between) {{
        {name} own[{3 * lanes}];
        vstore{lanes}(vload{lanes}(0, from), 1, own + 1);
        vstore{lanes}(vload{lanes}(1, own + 1), 1, between + 3);
        vstore{lanes}(vload{lanes}(1, between + 3), 1, out + 5);
    }}"""
    program = driver.compile_program(device.context, text, [])
    dtype = {"char": np.int8, "short": np.int16, "int": np.int32, "float": np.float32}[name]
    given, made = np.arange(1, lanes + 1, dtype=dtype), np.zeros(2 * lanes + 6, dtype)
    flags = cl.mem_flags.READ_WRITE | cl.mem_flags.COPY_HOST_PTR
    there, out = (cl.Buffer(device.context, flags, hostbuf=values) for values in (given, made))
    queue = cl.CommandQueue(device.context)
    local = cl.LocalMemory(3 * lanes * made.itemsize)
    program.moved(queue, (1,), None, there, out, local)
    cl.enqueue_copy(queue, made, out)
    assert made.tolist() == [0] * (lanes + 5) + given.tolist() + [0]


def test_an_error_is_told_by_the_line_of_its_own_text(device):
    with pytest.raises(KernelBuildError) as raised:
        device.programs.build("kernel void wrong(void) {\n    unknown = 1;\n}", [])
    assert re.search(r":2:\d+:? .*unknown", str(raised.value))


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
    assert driver.compile_program(own.context, text, []) is not None
    assert failed


def test_a_lock_that_a_killed_process_left_is_waited_for_a_moment_only(
    device, monkeypatch, tmp_path
):
    """A process that is killed while it reads or writes pyopencl's cache leaves the lock there, and
    each compilation of every later process waited a minute for it."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    own, text = Device(device.info, 1 << 20), "kernel void left(global int *out) { out[0] = 1; }"
    assert own.programs.build(text, ["-DFIRST"]) is not None
    for folder in (tmp_path / "pyopencl").glob("pyopencl-compiler-cache-*"):
        (folder / "lock").touch()
        began = time.monotonic()
        assert own.programs.build(text, ["-DSECOND"]) is not None
        assert time.monotonic() - began < 10
        assert not (folder / "lock").exists()


def test_a_lock_that_others_take_in_turns_is_theirs(monkeypatch, tmp_path):
    """Each time it is another file: the processes live."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(caches, "_HELD", 0.2)
    lock = tmp_path / "pyopencl" / "pyopencl-compiler-cache-v2" / "lock"
    lock.parent.mkdir(parents=True)
    lock.touch()

    def taken_anew(seconds):
        another = lock.with_name("another")
        another.touch()
        another.replace(lock)

    monkeypatch.setattr(caches.time, "sleep", taken_anew)
    caches.free_programs()
    assert lock.exists()


def test_the_files_of_drivers_stay_for_the_next_start(tmp_path, monkeypatch):
    """A process that is killed leaves none of its own."""
    system, kept = tmp_path / "system", tmp_path / "cache"
    system.mkdir()
    (system / "pocl.icd").write_text("libpocl.so\n")
    monkeypatch.setattr(loader, "SYSTEM_VENDORS", system)
    first = loader._vendor_folder(Path("/pip/libintelocl.so"), kept)
    held = {file.name: file.read_text() for file in first.iterdir()}
    assert held == {"pocl.icd": "libpocl.so\n", "intel-cpu.icd": "/pip/libintelocl.so\n"}
    (first / "pocl.icd").write_text("damaged")
    (first / "intel-cpu.icd").unlink()
    assert loader._vendor_folder(Path("/pip/libintelocl.so"), kept) == first
    assert {file.name: file.read_text() for file in first.iterdir()} == held
    other = loader._vendor_folder(Path("/other/libintelocl.so"), kept)
    assert other != first
    assert other.is_relative_to(kept)


def test_the_files_of_drivers_are_prepared_under_names_that_no_other_process_has(
    tmp_path, monkeypatch
):
    """Ids of processes are the same in two containers that share the folder of caches."""
    aside, kept = [], tmp_path / "cache"
    write = Path.write_bytes
    monkeypatch.setattr(Path, "write_bytes", lambda *of: aside.append(of[0]) or write(*of))
    for _ in range(2):
        found = loader._vendor_folder(Path("/pip/libintelocl.so"), kept)
        shutil.rmtree(found)
    assert len(set(aside)) == len(aside) > 0


def test_the_files_of_drivers_go_with_a_process_that_has_no_cache(tmp_path, monkeypatch):
    made = []
    monkeypatch.setattr(loader.tempfile, "mkdtemp", lambda prefix: str(tmp_path / prefix))
    monkeypatch.setattr(loader, "removed_at_exit", lambda folder: made.append(folder) or folder)
    (tmp_path / "cache").write_text("no folder")
    for kept in (None, tmp_path / "cache"):
        found = loader._vendor_folder(Path("/pip/libintelocl.so"), kept)
        assert found == made.pop() == tmp_path / "rhytid-opencl-"


@pytest.fixture
def told(monkeypatch):
    """What POCL_AFFINITY is, where it was `before` and a process may use some of the cores."""

    def found(cores, before=None):
        monkeypatch.setenv("POCL_AFFINITY", "")  # so that it is put back
        monkeypatch.delenv("POCL_AFFINITY")
        if before is not None:
            monkeypatch.setenv("POCL_AFFINITY", before)
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(os, "cpu_count", lambda: 4)
        monkeypatch.setattr(os, "sched_getaffinity", lambda pid: cores, raising=False)
        loader._pin_pocl()
        return os.environ.get("POCL_AFFINITY")

    return found


def test_pocl_is_pinned_where_every_core_may_be_used(told):
    assert told({0, 1, 2, 3}) == "1"


def test_pocl_is_not_pinned_to_cores_that_it_may_not_use(told):
    assert told({2, 3}) is None


def test_what_the_user_says_stands(told):
    assert told({0, 1, 2, 3}, before="0") == "0"


def keeps_sigint():
    """Whether this thread gets none."""
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, [])


def in_a_thread(call):
    found = []
    thread = threading.Thread(target=lambda: found.append(call()))
    thread.start()
    thread.join()
    return found[0]


def test_a_block_within_a_block_leaves_sigint_to_the_outer_one():
    def look():
        with driver.without_sigint():
            with driver.without_sigint():
                inner = keeps_sigint()
            between = keeps_sigint()
            with driver.driver_errors():
                calling = keeps_sigint()
            last = keeps_sigint()
        return inner, between, calling, last, keeps_sigint()

    for call in (look, lambda: in_a_thread(look)):
        assert call() == (True, True, True, True, False)


def test_a_task_keeps_sigint_from_the_driver_but_not_from_the_main_thread(device):
    def look():
        with device.task():
            return keeps_sigint()

    assert (in_a_thread(look), look()) == (True, False)
    assert in_a_thread(lambda: (look(), keeps_sigint())) == (True, False)


def test_the_system_is_asked_once_for_all_calls_of_a_task(device, monkeypatch):
    asked, ask = [], signal.pthread_sigmask

    def counted(*arguments):
        asked.append(arguments)
        return ask(*arguments)

    def work():
        with device.task():
            for _ in range(3):
                device.empty(16, "f4").release()
            device.finish()
        return len(asked)

    monkeypatch.setattr(signal, "pthread_sigmask", counted)
    assert in_a_thread(work) == 2


def test_what_compilers_say_is_not_told_while_several_threads_compile():
    """Outside pytest, which has filters of its own; `catch_warnings` of one thread would end those
    of another."""
    script = (
        "import warnings\n"
        "from rhytid.device.driver import cl\n"
        "warnings.warn('Non-empty compiler output', cl.CompilerWarning)\n"
        "warnings.warn('PyOpenCL compiler caching failed', UserWarning)\n"
        "warnings.warn('told', UserWarning)\n"
    )
    told = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60
    )
    assert told.stderr.count("Warning") == 1
    assert "told" in told.stderr

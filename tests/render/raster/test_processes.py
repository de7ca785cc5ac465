"""Contexts opened again and again, in forked and spawned workers, and on broken drivers; images of any size."""

import ctypes
import gc
import multiprocessing
import os
import subprocess
import sys
import textwrap
import warnings
from pathlib import Path

import numpy as np
import pytest

import render.raster.gl
from render import InputError, Mesh, frame_cameras, rasterize
from render.raster.context import GL_BACKENDS, GLUnavailableError, open_context
from render.raster.gl import gl_face_ids
from render.raster.osmesa import _open_library
from render.raster.peeling import NearestLayers
from render.raster.screen import screen_faces
from tests.helpers.example_meshes import random_soup, tube
from tests.helpers.paths import ROOT
from tests.helpers.raster_checks import distance_to_edges, peeled

MESH = tube(20, 12)
CAMERAS = frame_cameras(MESH, views="front,45/20", size=(48, 40), layers=2)


def draw(backend: str) -> np.ndarray:
    return rasterize(MESH, CAMERAS, backend=backend).face_id


def run_python(code: str, **environment: str) -> str:
    """Run code in a process of its own; a crash fails the test, and so does hanging for a minute."""
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "PYTHONPATH": str(ROOT), **environment},
    )
    assert done.returncode == 0, f"exit status {done.returncode}\n{done.stdout}\n{done.stderr}"
    return done.stdout


# Leaks


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_a_hundred_contexts_leave_no_files_and_no_memory(backend):
    def resident_mb():
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    thread = Mesh(np.array([[-0.5, -0.5, 0], [0.5, 0.5, 0], [0.5, 0.505, 0]]), np.array([[0, 1, 2]]))
    cameras = frame_cameras(thread, views="front", size=(512, 512))
    for _ in range(10):  # until caches are filled
        rasterize(thread, cameras, backend=backend)
    files, memory = len(os.listdir("/proc/self/fd")), resident_mb()
    for _ in range(100):
        rasterize(thread, cameras, backend=backend)
    assert len(os.listdir("/proc/self/fd")) <= files
    # moderngl 5.13 forgets the names of the driver's extensions, 0.04 MB a context (seen: 4 MB in all; nothing by the
    # drivers themselves). One image left behind a time would be 100 MB.
    assert resident_mb() - memory < 12


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_drawing_leaves_no_gl_objects_in_the_context(backend, monkeypatch):
    osmesa = backend == "osmesa"
    load = _open_library().OSMesaGetProcAddress if osmesa else ctypes.CDLL("libEGL.so.1").eglGetProcAddress
    load.restype, load.argtypes = ctypes.c_void_p, [ctypes.c_char_p]
    is_one = ctypes.CFUNCTYPE(ctypes.c_ubyte, ctypes.c_uint)
    kinds = ("Texture", "Buffer", "Framebuffer", "VertexArray", "Program", "Shader", "Renderbuffer")

    def living():
        """How many objects of each kind exist; the driver numbers them upwards."""
        exists = [is_one(load(f"glIs{kind}".encode())) for kind in kinds]
        return [sum(bool(one(number)) for number in range(1, 1000)) for one in exists]

    faces = screen_faces(MESH, CAMERAS[0])
    with open_context(backend) as context:
        gl_face_ids(context, faces, (48, 40))
        before = living()  # with the last program, which goes when another takes its place
        kept = context.gl.texture((4, 4), 1)
        assert living() == [before[0] + 1, *before[1:]]  # the count sees what is there
        kept.release()
        for _ in range(100):
            gl_face_ids(context, faces, (48, 40))
        assert living() == before
        # Nor where it ends half way.
        monkeypatch.setattr(NearestLayers, "add", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            gl_face_ids(context, faces, (48, 40))
        assert living() == before


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_a_driver_that_cannot_draw_is_named(backend, monkeypatch):
    monkeypatch.setattr(render.raster.gl, "_FRAGMENT_SHADER", "#version 330\nnonsense")
    with pytest.raises(InputError, match=rf"\({backend}\) fails to draw: GLSL Compiler failed"):
        draw(backend)


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_contexts_opened_inside_one_another_draw_each_its_own(backend):
    small, large = (frame_cameras(MESH, views="front", size=size)[0] for size in ((20, 30), (60, 50)))
    expected = [rasterize(MESH, [camera], backend=backend).face_id for camera in (small, large)]
    with open_context(backend) as outer:
        with open_context(backend) as inner:
            second = gl_face_ids(inner, screen_faces(MESH, large), large.size)
        first = gl_face_ids(outer, screen_faces(MESH, small), small.size)
    np.testing.assert_array_equal(first, expected[0])
    np.testing.assert_array_equal(second, expected[1])


# Processes


def from_queue(process, queue):
    process.start()
    found = queue.get(timeout=60)
    process.join(60)
    assert process.exitcode == 0
    return found


def draw_in_worker(backend, queue):
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            raster = rasterize(MESH, CAMERAS, backend=backend)
        queue.put((raster.backend, raster.face_id, [str(warning.message) for warning in caught]))
    except InputError as error:
        queue.put(("refused", None, [str(error)]))


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_spawned_workers_draw(backend):
    expected = draw(backend)
    start = multiprocessing.get_context("spawn")
    queue = start.Queue()
    name, ids, _ = from_queue(start.Process(target=draw_in_worker, args=(backend, queue)), queue)
    assert name == backend
    np.testing.assert_array_equal(ids, expected)


@pytest.mark.parametrize("backend", GL_BACKENDS)
@pytest.mark.parametrize("open_while_forking", [False, True])
def test_forked_workers_of_a_process_that_has_drawn(backend, open_while_forking):
    # Their copy of the driver lacks its threads and would wait for them for ever.
    expected = draw(backend)
    start = multiprocessing.get_context("fork")

    def forked(asked):
        queue = start.Queue()
        return from_queue(start.Process(target=draw_in_worker, args=(asked, queue)), queue)

    if open_while_forking:
        with open_context(backend) as context:
            faces = screen_faces(MESH, CAMERAS[0])
            before = gl_face_ids(context, faces, (48, 40))
            refused, fallen_back = forked(backend), forked("auto")
            np.testing.assert_array_equal(gl_face_ids(context, faces, (48, 40)), before)
    else:
        refused, fallen_back = forked(backend), forked("auto")
    assert refused[0] == "refused"
    assert "before this process was forked" in refused[2][0]
    assert "'spawn' or 'forkserver'" in refused[2][0]
    assert fallen_back[0] == "numpy"
    assert "'spawn' or 'forkserver'" in fallen_back[2][0]
    np.testing.assert_array_equal(fallen_back[1], rasterize(MESH, CAMERAS, backend="numpy").face_id)
    np.testing.assert_array_equal(draw(backend), expected)  # the parent is none the worse for it


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_workers_forked_before_anything_is_drawn_draw(backend):
    out = run_python(
        f"""
        import multiprocessing
        import tests.render.raster.test_processes as here
        start = multiprocessing.get_context("fork")
        with start.Pool(3) as pool:
            drawn = pool.map(here.draw, ["{backend}"] * 6)
        expected = here.draw("{backend}")
        print(all((ids == expected).all() for ids in drawn), len(drawn))
        """
    )
    assert out.split() == ["True", "6"]


def test_a_child_leaves_its_parents_open_context_alone():
    out = run_python(
        """
        import os, signal
        from render.raster.context import open_context
        with open_context("egl"):
            child = os.fork()
            signal.alarm(20)
        if child == 0:
            os._exit(7)  # left the block without touching the driver
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
        """
    )
    assert out.split() == ["7"]


# Broken drivers

BROKEN = {
    "no EGL vendor": ({"__EGL_VENDOR_LIBRARY_FILENAMES": "/nonexistent.json"}, "egl: "),
    "no such driver": ({"GALLIUM_DRIVER": "nonsense"}, "egl: eglInitialize failed"),
    "old OpenGL": ({"MESA_GL_VERSION_OVERRIDE": "2.1"}, "egl: eglCreateContext failed"),
}


@pytest.mark.parametrize("fault", BROKEN)
def test_a_broken_driver_is_one_clear_error_and_numpy_draws(fault):
    environment, message = BROKEN[fault]
    out = run_python(
        """
        import warnings
        warnings.simplefilter("ignore")
        import tests.render.raster.test_processes as here
        for backend in ("egl", "osmesa"):
            try:
                here.draw(backend)
                print("draws")
            except here.InputError as error:
                print(error)
        raster = here.rasterize(here.MESH, here.CAMERAS)
        print((raster.face_id == here.draw("numpy")).mean() > 0.99)
        """,
        **environment,
    )
    egl, osmesa, drawn = out.splitlines()
    assert egl.startswith(f"no GL from '{message}")
    assert egl.endswith("; run: apt-get install libegl1 libgl1-mesa-dri")
    assert osmesa == "draws" or osmesa.startswith("no GL from 'osmesa: ")
    assert drawn == "True"


# Sizes and many garments


@pytest.mark.parametrize("size", [(1, 1), (1, 97), (113, 1), (2, 3), (37, 211), (255, 129), (1024, 16)])
@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_images_of_any_size(size, backend):
    mesh = random_soup(9, 40, 60)
    cameras = frame_cameras(mesh, views="30/20", size=size)
    drawn = rasterize(mesh, peeled(cameras[0], 3), backend=backend)
    exact = rasterize(mesh, peeled(cameras[0], 3), backend="numpy")
    assert drawn.barycentric.shape == (3, *size, 3)
    assert drawn.mask.any()
    clear = distance_to_edges(mesh, cameras[0]) > 0.01
    np.testing.assert_array_equal(drawn.face_id[:, clear], exact.face_id[:, clear])


def test_many_garments_in_one_process():
    meshes = [random_soup(seed, 30 + seed, 20 + 3 * seed) for seed in range(12)]
    sizes = [(16 + 7 * k, 90 - 3 * k) for k in range(12)]

    def all_of_them(order):
        return {k: rasterize(meshes[k], frame_cameras(meshes[k], size=sizes[k])).face_id for k in order}

    once, again = all_of_them(range(12)), all_of_them(reversed(range(12)))
    for k in range(12):
        np.testing.assert_array_equal(once[k], again[k])


def test_the_error_of_a_missing_backend_says_how_to_get_it():
    assert GLUnavailableError("osmesa: gone").remedy == "run: apt-get install libosmesa6"
    assert GLUnavailableError("egl: gone", "wait").remedy == "wait"

import subprocess
import sys
import textwrap

import pytest

from render.raster.context import GL_BACKENDS, GLUnavailableError, open_context, probe_backends
from render.raster.osmesa import _TRIAL, OSMesaContext


def run_python(code, *arguments):
    """Run code in a process of its own and return its output; a crash of the process fails the test."""
    command = [sys.executable, "-c", textwrap.dedent(code), *arguments]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, f"exit status {done.returncode}\n{done.stderr}"
    return done.stdout.split()


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_triton_is_imported_before_a_context_is_created(backend, tmp_path):
    # Mesa's software renderer first and triton second kills the process. Torch for CPUs has no triton, so one that
    # only reports its import stands in.
    (tmp_path / "triton").mkdir()
    (tmp_path / "triton" / "__init__.py").write_text("print('triton')\n")
    events = run_python(
        """
        import sys
        sys.path.insert(0, sys.argv[1])
        import moderngl
        create = moderngl.create_context
        def reported(*args, **kwargs):
            print("context")
            return create(*args, **kwargs)
        moderngl.create_context = reported
        import numpy
        from render import Mesh, frame_cameras, rasterize
        mesh = Mesh(numpy.eye(3), numpy.array([[0, 1, 2]]))
        print("drawing")
        rasterize(mesh, frame_cameras(mesh), backend=sys.argv[2])
        """,
        str(tmp_path),
        backend,
    )
    assert events == ["drawing", "triton", "context"]


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_the_process_survives_drawing_and_then_using_triton(backend):
    # The real one where it is installed (CUDA builds of torch); elsewhere nothing can clash.
    events = run_python(
        """
        import importlib.util, sys
        from render.raster.context import open_context
        with open_context(sys.argv[1]) as context:
            print(context.backend)
        if importlib.util.find_spec("triton"):
            assert "triton" in sys.modules
            import triton._C.libtriton
        print("alive")
        """,
        backend,
    )
    assert events == [backend, "alive"]


def test_importing_render_loads_no_gl():
    assert run_python("import sys, render; print('moderngl' in sys.modules)") == ["False"]


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_a_context_is_released_on_error(backend, monkeypatch):
    import moderngl  # noqa: PLC0415

    released = []
    release = moderngl.Context.release
    monkeypatch.setattr(moderngl.Context, "release", lambda self: (released.append(self), release(self)))
    with pytest.raises(KeyError, match="in the middle"), open_context(backend):
        raise KeyError("in the middle")
    assert len(released) == 1


@pytest.mark.parametrize("backend", GL_BACKENDS)
def test_contexts_can_be_opened_again_and_inside_one_another(backend):
    for _ in range(3):
        with open_context(backend) as outer, open_context(backend) as inner:
            assert inner.gl.version_code >= 330
            assert outer.renderer


@pytest.mark.osmesa
def test_every_gl_backend_names_its_renderer():
    found = probe_backends()
    assert set(found) == set(GL_BACKENDS)
    assert all("unavailable" not in renderer for renderer in found.values())


def test_a_missing_library_is_reported(monkeypatch):
    monkeypatch.setattr("render.raster.osmesa._LIBRARIES", ("libNoSuchMesa.so",))
    with pytest.raises(GLUnavailableError, match=r"libNoSuchMesa\.so is installed"), open_context("osmesa"):
        pass
    assert probe_backends()["osmesa"].startswith("unavailable")


def test_an_unknown_backend_is_an_error_of_the_caller():
    with pytest.raises(ValueError, match="glx"), open_context("glx"):
        pass


@pytest.mark.osmesa
def test_osmesa_may_be_released_twice():
    context = OSMesaContext()
    assert context.load("glClear") != 0
    context.release()
    context.release()


@pytest.mark.osmesa
def test_the_trial_of_osmesa_needs_nothing_but_python():
    """Python's `operator` is not loaded yet without the site's modules, and this package has one of that name."""
    tried = subprocess.run([sys.executable, "-S", *_TRIAL], capture_output=True, text=True, check=False)
    assert (tried.returncode, tried.stderr) == (0, "")

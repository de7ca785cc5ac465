"""Warp started late, once and quietly."""

import os
import threading

import pytest

from fusion import warp_start
from fusion.warp_start import _without_driver_warning, launch


def test_only_the_one_line_about_the_driver_is_kept_back(capfd):
    with _without_driver_warning():
        os.write(2, b"Warp CUDA warning: Could not find or load the NVIDIA CUDA driver.\nsomething else\n")
        assert capfd.readouterr().err == ""  # passed on at the end
    assert capfd.readouterr().err == "something else\n"
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "after\n"


def fail_after_a_word():
    os.write(2, b"a word before\n")
    raise OSError("closed")


def test_what_fails_within_is_raised_and_stderr_comes_back(capfd):
    with pytest.raises(OSError, match="closed"), _without_driver_warning():
        fail_after_a_word()
    os.write(2, b"after\n")
    assert capfd.readouterr().err == "a word before\nafter\n"


class Launches:
    """Stands for Warp: notes how many launches run at once."""

    def __init__(self) -> None:
        self.now = self.most = self.count = 0
        self.fails = 0
        self._lock = threading.Lock()

    def launch(self, kernel, **arguments):
        with self._lock:
            self.now, self.count = self.now + 1, self.count + 1
            self.most = max(self.most, self.now)
        threading.Event().wait(0.02)
        with self._lock:
            self.now -= 1
        if self.fails:
            self.fails -= 1
            raise RuntimeError("does not compile")
        return kernel, arguments


@pytest.fixture
def warp(monkeypatch):
    launches = Launches()
    monkeypatch.setattr(warp_start, "warp_module", lambda: launches)
    monkeypatch.setattr(warp_start, "_built", set())
    return launches


def run(count, *kernels):
    threads = [threading.Thread(target=launch, args=(k,), kwargs={"device": "cpu"}) for k in kernels * count]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()


def test_the_first_launches_of_kernels_are_one_after_the_other_and_later_ones_are_not(warp):
    run(1, "a", "b", "c")
    assert warp.most == 1
    run(4, "a", "b")
    assert warp.most > 1
    assert warp.count == 3 + 8


def test_another_device_builds_again_and_what_did_not_build_is_not_taken_as_built(warp):
    assert launch("a", device="cpu", dim=3) == ("a", {"device": "cpu", "dim": 3})
    launch("a", device="cuda:0")
    assert warp_start._built == {("a", "cpu"), ("a", "cuda:0")}
    warp.fails = 1
    with pytest.raises(RuntimeError, match="does not compile"):
        launch("b", device="cpu")
    assert ("b", "cpu") not in warp_start._built
    launch("b", device="cpu")
    assert ("b", "cpu") in warp_start._built

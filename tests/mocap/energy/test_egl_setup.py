"""What is missing for a GPU is found in the machine's files, and the remedy is the one that helps."""

from collections.abc import Callable
from pathlib import Path

import pytest

from services.mocap.energy.egl_setup import CAPABILITIES, PACKAGES, EglSetup

Root = Callable[..., Path]
MESA = {
    "usr/lib/x86_64-linux-gnu/libEGL.so.1": "",
    "usr/lib/x86_64-linux-gnu/libGL.so.1": "",
    "usr/share/glvnd/egl_vendor.d/50_mesa.json": '{"ICD": {"library_path": "libEGL_mesa.so.0"}}',
}
DRIVER = {"proc/driver/nvidia/version": "NVRM version: …"}
LIBRARY = {"usr/lib/x86_64-linux-gnu/libEGL_nvidia.so.0": ""}
VENDOR = {
    "usr/share/glvnd/egl_vendor.d/10_nvidia.json": '{"ICD": {"library_path": "libEGL_nvidia.so.0"}}',
}


@pytest.fixture
def root(tmp_path: Path) -> Root:
    """`root(files, …)`: a machine's file tree."""

    def make(*trees: dict[str, str]) -> Path:
        for tree in trees:
            for name, text in tree.items():
                (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
                (tmp_path / name).write_text(text)
        return tmp_path

    return make


def test_an_empty_machine_is_told_the_packages(root: Root) -> None:
    setup = EglSetup.look(root(), {})
    assert setup.lacking == ["libEGL.so.1", "libGL.so.1"]
    assert setup.remedy() == f"run apt-get install --no-install-recommends {PACKAGES}"
    assert PACKAGES == "libegl1 libgl1 libgl1-mesa-dri"


def test_nothing_is_amiss_with_mesa_alone(root: Root) -> None:
    setup = EglSetup.look(root(MESA), {})
    assert (setup.lacking, setup.nvidia_driver, setup.remedy()) == ([], False, "")
    assert [path.name for path in setup.vendor_files] == ["50_mesa.json"]


@pytest.mark.parametrize("lost", ["libEGL.so.1", "libGL.so.1", "50_mesa.json"])
def test_each_part_of_the_packages_is_missed(root: Root, lost: str) -> None:
    there = {name: text for name, text in MESA.items() if not name.endswith(lost)}
    assert PACKAGES in EglSetup.look(root(there), {}).remedy()


@pytest.mark.parametrize("granted", ["graphics", "all", "compute,utility,graphics", " graphics , compute"])
def test_a_container_that_asks_for_graphics_is_well(root: Root, granted: str) -> None:
    setup = EglSetup.look(root(MESA, DRIVER, LIBRARY, VENDOR), {CAPABILITIES: granted})
    assert setup.nvidia_driver
    assert setup.remedy() == ""


@pytest.mark.parametrize("granted", ["compute,utility", "", "video"])
def test_a_container_that_does_not_is_told_to(root: Root, granted: str) -> None:
    remedy = EglSetup.look(root(MESA, DRIVER), {CAPABILITIES: granted}).remedy()
    assert remedy.startswith("start the container with NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility")
    assert (granted or "an empty one") in remedy


def test_a_driver_without_its_library_is_told_both_ways(root: Root) -> None:
    remedy = EglSetup.look(root(MESA, DRIVER), {}).remedy()
    assert "without libEGL_nvidia.so.0" in remedy
    assert "NVIDIA_DRIVER_CAPABILITIES=graphics,compute,utility" in remedy
    assert "libnvidia-gl" in remedy


def test_a_missing_vendor_file_is_given_whole_and_helps(root: Root) -> None:
    folder = root(MESA, DRIVER, LIBRARY)
    remedy = EglSetup.look(folder, {CAPABILITIES: "all"}).remedy()
    text, _, name = remedy.removeprefix("write ").partition(" to ")
    assert name == "/usr/share/glvnd/egl_vendor.d/10_nvidia.json"
    (folder / name.removeprefix("/")).write_text(text)
    mended = EglSetup.look(folder, {CAPABILITIES: "all"})
    assert mended.remedy() == ""
    assert mended.nvidia_vendor_file is not None
    assert mended.nvidia_vendor_file.name == "10_nvidia.json"


def test_a_device_without_proc_shows_the_driver_too(root: Root) -> None:
    assert EglSetup.look(root({"dev/nvidia0": ""}), {}).nvidia_driver
    assert not EglSetup.look(
        root({"dev/nvidia-caps/x": "", "dev/nvidiactl": ""}).parent / "other", {}
    ).nvidia_driver


def test_libraries_named_in_the_environment_are_found_first(root: Root, tmp_path: Path) -> None:
    setup = EglSetup.look(root(MESA, {"mine/libEGL.so.1": ""}), {"LD_LIBRARY_PATH": f":{tmp_path}/mine"})
    assert setup.libegl == tmp_path / "mine" / "libEGL.so.1"
    assert setup.libgl == tmp_path / "usr/lib/x86_64-linux-gnu/libGL.so.1"


def test_vendor_files_come_from_etc_first(root: Root) -> None:
    setup = EglSetup.look(root(MESA, VENDOR, {"etc/glvnd/egl_vendor.d/90_mine.json": "{}"}), {})
    assert [path.name for path in setup.vendor_files] == ["90_mine.json", "10_nvidia.json", "50_mesa.json"]


def test_vendor_folders_of_the_environment_take_the_place_of_the_usual_ones(root: Root) -> None:
    folder = root(MESA, {"vendors/b.json": "{}", "vendors/a.json": "{}", "vendors/c.txt": ""})
    setup = EglSetup.look(folder, {"__EGL_VENDOR_LIBRARY_DIRS": f"{folder}/vendors:{folder}/none"})
    assert [path.name for path in setup.vendor_files] == ["a.json", "b.json"]


def test_vendor_files_of_the_environment_take_the_place_of_all(root: Root) -> None:
    folder = root(MESA, DRIVER, LIBRARY, VENDOR)
    only_mesa = str(folder / "usr/share/glvnd/egl_vendor.d/50_mesa.json")
    env = {"__EGL_VENDOR_LIBRARY_FILENAMES": f"{only_mesa}:/nowhere.json"}
    setup = EglSetup.look(folder, env)
    assert [path.name for path in setup.vendor_files] == ["50_mesa.json"]
    assert "__EGL_VENDOR_LIBRARY_FILENAMES" in setup.remedy()

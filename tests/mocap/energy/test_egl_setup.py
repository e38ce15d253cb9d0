"""What is missing for a GPU is found in the machine's files, and the remedy is the one that helps."""

from collections.abc import Callable
from pathlib import Path

import pytest

from services.mocap.energy.egl_setup import CAPABILITIES, PACKAGES, EglSetup

Root = Callable[..., Path]
MESA = {
    "usr/lib/x86_64-linux-gnu/libEGL.so.1": "",
    "usr/lib/x86_64-linux-gnu/libGL.so.1": "",
    "usr/lib/x86_64-linux-gnu/libEGL_mesa.so.0": "",
    "usr/lib/x86_64-linux-gnu/dri/swrast_dri.so": "",
    "usr/share/glvnd/egl_vendor.d/50_mesa.json": '{"ICD": {"library_path": "libEGL_mesa.so.0"}}',
}
DRIVER = {"proc/driver/nvidia/version": "NVRM version: …"}
LIBRARY = {"usr/lib/x86_64-linux-gnu/libEGL_nvidia.so.0": ""}
VENDOR = {"usr/share/glvnd/egl_vendor.d/10_nvidia.json": '{"ICD": {"library_path": "libEGL_nvidia.so.0"}}'}


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


@pytest.mark.parametrize("lost", ["libEGL.so.1", "libGL.so.1", "50_mesa.json", "libEGL_mesa.so.0", "dri.so"])
def test_each_part_of_the_packages_is_missed(root: Root, lost: str) -> None:
    there = {name: text for name, text in MESA.items() if not name.endswith(lost)}
    assert PACKAGES in EglSetup.look(root(there), {}).remedy()


def test_mesas_drivers_may_be_one_file_or_elsewhere(root: Root) -> None:
    folder = root({name: text for name, text in MESA.items() if not name.endswith("dri.so")})
    assert PACKAGES in EglSetup.look(folder, {}).remedy()
    (folder / "drivers").mkdir()
    (folder / "drivers/radeonsi_dri.so").touch()
    assert EglSetup.look(folder, {"LIBGL_DRIVERS_PATH": f"{folder}/none:{folder}/drivers"}).remedy() == ""
    (folder / "usr/lib/x86_64-linux-gnu/libgallium-25.0.7-2.so").touch()
    assert EglSetup.look(folder, {}).remedy() == ""


def test_mesa_is_not_missed_where_no_vendor_file_names_it(root: Root) -> None:
    there = {name: text for name, text in MESA.items() if "mesa" not in name and "dri" not in name}
    assert EglSetup.look(root(there, DRIVER, LIBRARY, VENDOR), {}).remedy() == ""


def card(number: str, pci_class: str = "0x030000") -> dict[str, str]:
    folder = "sys/bus/pci/devices/0000:03:00.0"
    return {f"{folder}/class": f"{pci_class}\n", f"{folder}/vendor": f"{number}\n"}


@pytest.mark.parametrize(("number", "maker"), [("0x1002", "AMD"), ("0x8086", "Intel")])
def test_a_card_without_a_render_node_is_told_how_to_get_one(root: Root, number: str, maker: str) -> None:
    setup = EglSetup.look(root(MESA, card(number), {"dev/dri/card0": ""}), {})
    assert setup.gpu == maker
    assert setup.remedy() == (
        f"the {maker} GPU has no /dev/dri/renderD128: start the container with --device /dev/dri, or without "
        "a container load the card's kernel driver"
    )


def test_a_render_node_that_may_not_be_opened_is_told_the_group(
    root: Root, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = root(MESA, card("0x1002"), {"dev/dri/renderD128": "", "dev/dri/renderD129": ""})
    assert EglSetup.look(folder, {}).remedy() == ""
    closed = {folder / "dev/dri/renderD128"}
    monkeypatch.setattr("os.access", lambda path, _: path not in closed)
    assert EglSetup.look(folder, {}).remedy() == ""
    closed.add(folder / "dev/dri/renderD129")
    remedy = EglSetup.look(folder, {}).remedy()
    node = f"{folder}/dev/dri/renderD128"
    assert remedy.startswith(f"you may not open {node}: run sudo usermod -aG render $USER and log in again")
    assert remedy.endswith(f"--group-add $(stat -c %g {node})")


@pytest.mark.parametrize("other", [card("0x1234"), card("0x8086", "0x060000"), card("0x1002", "0x040300")])
def test_what_is_no_card_that_mesa_drives_is_passed_over(root: Root, other: dict[str, str]) -> None:
    setup = EglSetup.look(root(MESA, other), {})
    assert (setup.gpu, setup.remedy()) == ("", "")


def test_nvidias_remedy_comes_before_that_of_a_card_beside_it(root: Root) -> None:
    setup = EglSetup.look(root(MESA, DRIVER, card("0x8086")), {})
    assert setup.gpu == "NVIDIA"
    assert "libEGL_nvidia" in setup.remedy()
    assert "/dev/dri" not in setup.remedy()


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

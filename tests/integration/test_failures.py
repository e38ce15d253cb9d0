"""What happens when something dies or is stopped in the middle of a take."""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import psutil
import pytest
from lasting_servers import LastingServers
from one_process import tracked_here

from first_pose import say_first_pose
from known_actor import write_take_of_known_actor
from patience import until
from services.mocap.energy.settings import EngineSettings
from services.mocap.search.settings import PRESETS, SearchSettings
from services.mocap.take.folder import open_take
from services.mocap.take.tables import read_poses_csv
from services.recorder.store import Store
from services.runs import Interrupted, ServiceFailedError
from services.runs.launcher import Launcher
from services.runs.progress import Progress
from services.runs.track import TakeJob, track

pytestmark = [pytest.mark.timeout(280), pytest.mark.usefixtures("no_report")]

FRAMES = 9
SLOW = PRESETS["paper"]
"""Every frame has work for every worker, and takes long enough to do something before the last."""
BOTH_WAYS = SearchSettings(search_limbs="always")
Deed = Callable[[Launcher], None]


def _alive(pid: int) -> bool:
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def _children(pid: int) -> list[int]:
    return [child.pid for child in psutil.Process(pid).children(recursive=True)]


class Run:
    """A run in this process's name, in which deeds are done once so many frames are solved."""

    lasting: LastingServers
    """What stays after a run."""

    def __init__(
        self, take: Path, out: Path, *, overlay: bool = False, search: SearchSettings = SLOW
    ) -> None:
        self._take, self.out, self._overlay, self._search = take, out, overlay, search
        self._launchers: list[Launcher] = []
        self._pids: list[int] = []
        self._deeds: list[tuple[Callable[[Progress], bool], Deed]] = []

    def when(self, condition: Callable[[Progress], bool], deed: Deed) -> "Run":
        self._deeds.append((condition, deed))
        return self

    def _show(self, progress: Progress) -> None:
        for entry in [entry for entry in self._deeds if entry[0](progress)]:
            self._deeds.remove(entry)
            entry[1](self._launchers[0])

    def _started(self, launcher: Launcher) -> None:
        self._launchers[:] = [launcher]
        self._pids = _children(os.getpid())

    def go(self, warn: Callable[[str], None] = lambda _: None) -> dict:
        try:
            take = open_take(self._take)
            job = TakeJob(
                take=take,
                out=self.out,
                frames=range(FRAMES),
                workers=2,
                overlay=self._overlay,
                engine=EngineSettings(),
                search=self._search,
            )
            return track(job, show=self._show, started=self._started, warn=warn)
        finally:
            assert not self._deeds, "the run ended before something was done to it"
            assert self._pids
            left = {pid for pid in self._pids if _alive(pid)}
            assert left <= self.lasting.pids, "a process was left behind"

    def frames(self) -> list[int]:
        return read_poses_csv(self.out / "poses.csv").frames.tolist()


def after(frames: int) -> Callable[[Progress], bool]:
    return lambda progress: progress.frames_done >= frames


def kill(name: str, number: signal.Signals) -> Deed:
    def deed(launcher: Launcher) -> None:
        if launcher.pids(name):  # else it has not been started again yet
            os.kill(launcher.pids(name)[0], number)

    return deed


def kill_all_that_know_poses(launcher: Launcher) -> None:
    kill("coordinator", signal.SIGKILL)(launcher)
    kill("recorder", signal.SIGKILL)(launcher)


def ask_to_stop(_: Launcher) -> None:
    os.kill(os.getpid(), signal.SIGINT)


@pytest.fixture(scope="module", autouse=True)
def _(lasting_servers: LastingServers) -> None:
    Run.lasting = lasting_servers


@pytest.fixture
def run(exact_take: Path, tmp_path: Path) -> Run:
    return Run(exact_take, tmp_path / "out")


def _by_one_process(folder: Path, out: Path, search: SearchSettings) -> Path:
    """The results of a take to which nothing happens."""
    return tracked_here(folder, out, f"0:{FRAMES}", search)


@pytest.fixture(scope="module")
def undisturbed(exact_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run that nothing happens to."""
    return _by_one_process(exact_take, tmp_path_factory.mktemp("undisturbed") / "out", SLOW)


@pytest.fixture(scope="module")
def filmed_take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A take with as few videos and frames as are needed, its first pose said."""
    folder = tmp_path_factory.mktemp("filmed") / "walk"
    write_take_of_known_actor(folder, n_frames=FRAMES, n_cameras=3)
    say_first_pose(folder)
    return folder


def test_whoever_dies_beside_the_coordinator_costs_no_frame_and_changes_none(
    filmed_take: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With videos, whose background is learnt again: the poses are those that one process finds."""
    monkeypatch.setattr("services.runs.local_run._CHECKS_S", 2.0)  # segmentation may come back too late
    run = Run(filmed_take, tmp_path / "out")
    alone = _by_one_process(filmed_take, tmp_path / "alone" / "result", SLOW)
    run.when(after(0), kill("segmentation", signal.SIGTERM))
    run.when(after(1), kill("segmentation", signal.SIGKILL))
    run.when(after(2), kill("limb_worker", signal.SIGKILL))
    report = run.when(after(4), kill("recorder", signal.SIGKILL)).go()
    assert report["take"]["frames"] == FRAMES
    assert (run.out / "poses.csv").read_text() == (alone / "poses.csv").read_text()
    left = {path.name for path in run.out.parent.iterdir()}
    assert left == {"alone", "out"}, "the journal is not needed any more"


@pytest.mark.usefixtures("own_imports")
def test_a_coordinator_that_dies_alone_or_with_the_recorder_goes_on_as_if_nothing_had_happened(
    run: Run, undisturbed: Path
) -> None:
    said: list[str] = []

    run.when(after(1), kill("coordinator", signal.SIGKILL))
    run.when(after(3), kill("coordinator", signal.SIGKILL))
    run.when(after(5), kill_all_that_know_poses).go(warn=said.append)
    assert (run.out / "poses.csv").read_text() == (undisturbed / "poses.csv").read_text()
    assert any("continuing run" in sentence for sentence in said)


@pytest.fixture(scope="module")
def undisturbed_both_ways(exact_take: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same, tracked back from the last frame as well."""
    return _by_one_process(exact_take, tmp_path_factory.mktemp("both-ways") / "out", BOTH_WAYS)


def test_deaths_on_the_way_back_and_while_poses_are_settled_change_nothing(
    exact_take: Path, tmp_path: Path, undisturbed_both_ways: Path
) -> None:
    run = Run(exact_take, tmp_path / "disturbed" / "out", search=BOTH_WAYS)

    def in_stage(stage: str, done: int) -> Callable[[Progress], bool]:
        return lambda progress: progress.stage == stage and progress.frames_done >= done

    run.when(in_stage("tracking back", 1), kill("coordinator", signal.SIGKILL))
    run.when(in_stage("settling", 1), kill("recorder", signal.SIGKILL))
    run.when(in_stage("settling", 3), kill("limb_worker", signal.SIGKILL))
    report = run.when(in_stage("settling", 5), kill_all_that_know_poses).go()
    assert report["take"]["frames"] == FRAMES
    assert (run.out / "poses.csv").read_text() == (undisturbed_both_ways / "poses.csv").read_text()
    assert [path.name for path in run.out.parent.iterdir()] == ["out"]


def test_frames_that_were_not_recorded_at_the_end_of_the_take_are_solved_again(
    run: Run, undisturbed: Path
) -> None:
    ended_s: list[float] = []

    def well_after_the_end(progress: Progress) -> bool:
        if progress.telemetry is not None and progress.telemetry.stage == "ended":
            ended_s.append(time.monotonic())
        return bool(ended_s) and time.monotonic() - ended_s[0] > 1  # everybody has heard of it

    run.when(after(2), kill("recorder", signal.SIGSTOP))
    run.when(well_after_the_end, kill_all_that_know_poses).go()
    assert (run.out / "poses.csv").read_text() == (undisturbed / "poses.csv").read_text()


def test_a_recorder_that_dies_while_it_writes_results_writes_them_after_all(
    exact_take: Path, tmp_path: Path, undisturbed: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.runs.local_run._STARTING_S", 5.0)  # all of which is waited for
    run = Run(exact_take, tmp_path / "out", overlay=True)  # which takes its time
    run.when(lambda progress: progress.stage == "writing results", kill("recorder", signal.SIGKILL)).go()
    assert (run.out / "poses.csv").read_text() == (undisturbed / "poses.csv").read_text()
    assert [path.name for path in run.out.parent.iterdir()] == ["out"]


def test_a_coordinator_that_dies_again_and_again_is_said_and_its_frames_are_kept(
    run: Run, undisturbed: Path
) -> None:
    for frames in range(1, 7):
        run.when(after(frames), kill("coordinator", signal.SIGKILL))
    with pytest.raises(
        ServiceFailedError, match=r"coordinator crashed again after 5 restarts \(exit code"
    ) as failure:
        run.go()
    assert len(run.frames()) >= 5
    assert run.frames() == list(range(len(run.frames())))
    shutil.rmtree(str(failure.value).rpartition(" ")[2])  # the logs
    store = Store(run.out.with_name("out.partial"))
    assert sorted(store.first.frames) == run.frames()
    store.close(remove=False)
    run.go()  # the same run again goes on from there
    assert (run.out / "poses.csv").read_text() == (undisturbed / "poses.csv").read_text()


def test_a_recorder_that_hangs_for_a_while_still_writes_all(run: Run, undisturbed: Path) -> None:
    ended_s: list[float] = []

    def long_after_the_end(progress: Progress) -> bool:
        if progress.frames_done == FRAMES:
            ended_s.append(time.monotonic())
        return bool(ended_s) and time.monotonic() - ended_s[0] > 4  # its connection is cut by then

    run.when(after(2), kill("recorder", signal.SIGSTOP))
    run.when(long_after_the_end, kill("recorder", signal.SIGCONT)).go()
    assert (run.out / "poses.csv").read_text() == (undisturbed / "poses.csv").read_text()


@pytest.mark.usefixtures("own_imports")
def test_a_stop_leaves_the_frames_done_by_then_in_complete_files(run: Run) -> None:
    with pytest.raises(Interrupted) as stopped:
        run.when(after(2), ask_to_stop).go()
    assert stopped.value.folder == run.out
    assert 2 <= len(run.frames()) < FRAMES
    assert run.frames() == list(range(len(run.frames())))
    assert {"motion.bvh", "run.json", "logs"} <= {path.name for path in run.out.iterdir()}


def test_a_stopped_run_does_not_replace_a_complete_one(run: Run, undisturbed: Path) -> None:
    shutil.copytree(undisturbed, run.out)
    with pytest.raises(Interrupted) as stopped:
        run.when(after(1), ask_to_stop).go()
    assert stopped.value.folder == run.out.with_name("out.partial")
    assert (run.out / "poses.csv").read_text() == (undisturbed / "poses.csv").read_text()


def test_a_stop_on_the_way_back_ends_the_run_which_goes_on_from_there(
    exact_take: Path, tmp_path: Path, undisturbed_both_ways: Path
) -> None:
    run = Run(exact_take, tmp_path / "out", search=BOTH_WAYS)
    with pytest.raises(Interrupted) as stopped:
        run.when(lambda progress: progress.stage == "tracking back", ask_to_stop).go()
    assert stopped.value.folder == run.out
    one_way = BOTH_WAYS.model_copy(update={"both_ways": False})
    expected = _by_one_process(exact_take, tmp_path / "one-way", one_way)
    assert (run.out / "poses.csv").read_text() == (expected / "poses.csv").read_text()
    run.go()
    assert (run.out / "poses.csv").read_text() == (undisturbed_both_ways / "poses.csv").read_text()


@pytest.mark.usefixtures("own_imports")  # so that one is shortly before the first frame, or after it
@pytest.mark.parametrize("seconds", [0.0, 1.5])
def test_a_stop_about_the_first_frame_ends_at_once(run: Run, seconds: float, tmp_path: Path) -> None:
    began_s = time.monotonic()
    run.when(lambda _: time.monotonic() - began_s >= seconds, ask_to_stop)
    try:
        run.go()
    except Interrupted as stopped:
        assert (stopped.folder is None) == (not run.out.exists())
    else:
        pytest.fail("the run went on")
    assert time.monotonic() - began_s < 45  # it takes 5 s; the machine may be busy
    # With a frame there is a journal, too, from which the same run goes on.
    expected = {"out", "out.partial"} if run.out.exists() else set()
    assert {path.name for path in tmp_path.iterdir()} == expected


def test_two_stops_while_results_are_written_lose_nothing(exact_take: Path, tmp_path: Path) -> None:
    run = Run(exact_take, tmp_path / "out", overlay=True)

    def stop_twice(launcher: Launcher) -> None:
        ask_to_stop(launcher)
        ask_to_stop(launcher)

    run.when(lambda progress: progress.stage == "writing results", stop_twice)
    assert run.go()["take"]["frames"] == FRAMES
    assert [path.name for path in tmp_path.iterdir()] == ["out"]


@pytest.fixture
def command(exact_take: Path, tmp_path: Path) -> Iterator["subprocess.Popen[str]"]:
    """The command as a process of its own, once its services run."""
    arguments = ["track", str(exact_take), "--search", "plain", "--workers", "1", "--no-check"]
    process = subprocess.Popen(
        [sys.executable, "-m", "services.cli", *arguments, "--out", str(tmp_path / "out")],
        stderr=subprocess.PIPE,
        text=True,
    )
    starter = sys.platform == "linux"  # a process of its own, of which services are copies
    until(lambda: len(_children(process.pid)) == 4 + starter)
    yield process
    process.kill()
    process.wait()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_stopped_command_says_so(command: "subprocess.Popen[str]", number: signal.Signals) -> None:
    time.sleep(1)
    command.send_signal(number)
    _, said = command.communicate(timeout=60)
    assert command.returncode == 130
    assert "stopped; " in said
    assert "Traceback" not in said


def test_no_process_outlives_a_killed_command(command: "subprocess.Popen[str]") -> None:
    children = _children(command.pid)
    command.kill()
    command.wait()
    until(lambda: not any(_alive(pid) for pid in children))

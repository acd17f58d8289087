"""Writing files whole or not at all, whatever goes wrong in between."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from dmp.files import TEMPORARY_SUFFIX, atomic_write, atomic_write_bytes, in_words

OLD, NEW = b"old content", b"new content, longer than the old"


@pytest.fixture
def target(tmp_path: Path) -> Path:
    path = tmp_path / "result.bin"
    path.write_bytes(OLD)
    return path


def assert_untouched(target: Path) -> None:
    assert target.read_bytes() == OLD
    assert [path.name for path in target.parent.iterdir() if path.suffix] == [target.name]


def test_a_new_and_an_existing_file(tmp_path: Path) -> None:
    path = tmp_path / "result.bin"
    for content in (OLD, NEW, b"", b"x" * 5_000_000):
        atomic_write_bytes(path, content)
        assert path.read_bytes() == content
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_the_name_is_taken_only_at_the_end_of_the_block(target: Path) -> None:
    with atomic_write(target) as file:
        file.write(NEW)
        file.flush()
        assert target.read_bytes() == OLD
    assert target.read_bytes() == NEW


def test_writers_may_go_back_and_forth(target: Path) -> None:
    with atomic_write(target) as file:
        file.write(b"....BBBB")
        file.seek(0)
        file.write(b"AAAA")
    assert target.read_bytes() == b"AAAABBBB"


@pytest.mark.parametrize("error", [RuntimeError, KeyboardInterrupt, GeneratorExit, MemoryError])
def test_an_error_in_the_block_keeps_the_old_file(target: Path, error: type[BaseException]) -> None:
    with pytest.raises(error), atomic_write(target) as file:
        file.write(NEW)
        raise error
    assert_untouched(target)


def test_an_error_of_the_check_keeps_the_old_file(target: Path) -> None:
    def check(temporary: Path) -> None:
        assert temporary.read_bytes() == NEW
        raise ValueError

    with pytest.raises(ValueError), atomic_write(target, check=check) as file:
        file.write(NEW)
    assert_untouched(target)


def test_everything_is_synchronised_before_and_after_the_renaming(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls: list[str] = []
    fsync, replace = os.fsync, Path.replace

    def record_fsync(descriptor: int) -> None:
        calls.append("folder" if os.path.isdir(f"/proc/self/fd/{descriptor}") else "file")  # noqa: PTH112
        fsync(descriptor)

    def record_replace(path: Path, other: Path) -> Path:
        assert path.read_bytes() == NEW
        calls.append("rename")
        return replace(path, other)

    monkeypatch.setattr(os, "fsync", record_fsync)
    monkeypatch.setattr(Path, "replace", record_replace)
    atomic_write_bytes(target, NEW)
    assert calls == ["file", "rename", "folder"]


@pytest.mark.parametrize("code", [errno.ENOSPC, errno.EIO, errno.EDQUOT])
def test_a_disk_that_is_full_at_the_synchronisation(target: Path, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    def fail(descriptor: int) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(OSError) as caught:
        atomic_write_bytes(target, NEW)
    assert caught.value.errno == code
    assert_untouched(target)


def test_a_disk_that_returns_other_data(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "fsync", lambda descriptor: os.pwrite(descriptor, b"?", 3))
    with pytest.raises(OSError, match="does not hold"):
        atomic_write_bytes(target, NEW)
    assert_untouched(target)


def test_a_folder_that_cannot_be_synchronised_is_no_error(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fsync = os.fsync

    def refuse_folders(descriptor: int) -> None:
        if os.path.isdir(f"/proc/self/fd/{descriptor}"):  # noqa: PTH112
            raise OSError(errno.EINVAL, "no folders here")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", refuse_folders)
    atomic_write_bytes(target, NEW)
    assert target.read_bytes() == NEW


def run(code: str, *arguments: Path) -> subprocess.CompletedProcess:
    root = Path(__file__).resolve().parents[2]
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code), *map(str, arguments)],
        cwd=root,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_a_disk_that_is_full_at_the_writing(target: Path) -> None:
    done = run(
        """
        import resource, sys
        from dmp.files import atomic_write, in_words
        resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
        try:
            with atomic_write(sys.argv[1]) as file:
                for _ in range(100):
                    file.write(b"x" * 4096)
        except OSError as error:
            print(in_words(error))
        """,
        target,
    )
    assert done.stdout == "the file is larger than the system allows\n"
    assert_untouched(target)


@pytest.mark.parametrize("call", ["os.fsync", "pathlib.Path.replace"])
def test_a_program_that_dies_at_a_call_leaves_the_old_file(target: Path, call: str) -> None:
    done = run(
        f"""
        import os, pathlib, sys
        from dmp.files import atomic_write_bytes
        {call} = lambda *arguments: os._exit(9)
        atomic_write_bytes(sys.argv[1], {NEW!r})
        """,
        target,
    )
    assert done.returncode == 9
    assert target.read_bytes() == OLD
    # What is left over has a name that nothing takes for a result.
    assert all(path == target or path.name.endswith(TEMPORARY_SUFFIX) for path in target.parent.iterdir() if path.is_file())


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="there is no SIGKILL here")
def test_a_program_that_is_killed_again_and_again_leaves_whole_files(target: Path) -> None:
    contents = [bytes([65 + letter]) * 300_000 for letter in range(26)]
    target.write_bytes(contents[0])
    code = """
        import sys
        from dmp.files import atomic_write_bytes
        while True:
            for letter in range(26):
                atomic_write_bytes(sys.argv[1], bytes([65 + letter]) * 300_000)
                print(letter, flush=True)
    """
    root = Path(__file__).resolve().parents[2]
    for attempt in range(4):
        command = [sys.executable, "-c", textwrap.dedent(code), str(target)]
        with subprocess.Popen(command, cwd=root, stdout=subprocess.PIPE, text=True) as process:
            assert process.stdout is not None
            process.stdout.readline()
            time.sleep(0.003 * attempt)
            process.kill()
        assert target.read_bytes() in contents


def test_links_are_followed_and_stay(target: Path) -> None:
    link = target.with_name("link.bin")
    link.symlink_to(target.name)
    atomic_write_bytes(link, NEW)
    assert link.is_symlink()
    assert target.read_bytes() == NEW


def test_a_link_to_nothing_makes_its_target(tmp_path: Path) -> None:
    link = tmp_path / "link.bin"
    link.symlink_to("made.bin")
    atomic_write_bytes(link, NEW)
    assert (tmp_path / "made.bin").read_bytes() == NEW


def test_links_that_are_not_followed_are_replaced(target: Path, tmp_path: Path) -> None:
    link, folder = tmp_path / "link.bin", tmp_path / "folder"
    link.symlink_to(target.name)
    folder.mkdir()
    (tmp_path / "to_folder").symlink_to("folder")
    for path in (link, tmp_path / "to_folder"):
        atomic_write_bytes(path, NEW, follow_link=False)
        assert not path.is_symlink()
        assert path.read_bytes() == NEW
    assert target.read_bytes() == OLD
    assert folder.is_dir()
    with pytest.raises(IsADirectoryError):
        atomic_write_bytes(folder, NEW, follow_link=False)


def test_permissions_stay(target: Path) -> None:
    target.chmod(0o640)
    atomic_write_bytes(target, NEW)
    assert target.stat().st_mode & 0o777 == 0o640


def test_a_new_file_has_the_usual_permissions(tmp_path: Path) -> None:
    atomic_write_bytes(tmp_path / "a.bin", NEW)
    (tmp_path / "b.bin").write_bytes(NEW)
    assert (tmp_path / "a.bin").stat().st_mode == (tmp_path / "b.bin").stat().st_mode


def test_a_write_protected_file_is_not_replaced(target: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target.chmod(0o444)
    monkeypatch.setattr(os, "access", lambda path, mode: False)  # for the superuser nothing is protected
    with pytest.raises(PermissionError):
        atomic_write_bytes(target, NEW)
    assert_untouched(target)


def test_the_longest_names_work(tmp_path: Path) -> None:
    path = tmp_path / ("ä" * 125 + ".bin")  # 254 bytes
    atomic_write_bytes(path, NEW)
    assert path.read_bytes() == NEW


def test_places_that_cannot_be_written(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").write_bytes(OLD)
    (tmp_path / "circle").symlink_to("circle")
    expected = {
        tmp_path / "missing" / "a.bin": "the file or its folder does not exist",
        tmp_path / "file" / "a.bin": "a part of its path is a file, not a folder",
        tmp_path / "folder": "it is a folder",
        tmp_path / "pipe": "it is a pipe, a device or a socket, not a file",
        tmp_path / "circle": "it is a link that leads in a circle",
        tmp_path / ("a" * 300): "its name is too long",
        Path("/dev/null"): "it is a pipe, a device or a socket, not a file",
    }
    for path, words in expected.items():
        with pytest.raises(OSError) as caught, atomic_write(path):
            raise AssertionError("the block must not be entered")
        assert in_words(caught.value) == words
    assert sorted(path.name for path in tmp_path.iterdir() if not path.name.startswith("xdg")) == [
        "circle",
        "file",
        "folder",
        "pipe",
    ]


def test_unknown_errors_are_told_in_the_words_of_the_system() -> None:
    assert in_words(OSError(errno.EDEADLK, "Resource deadlock avoided")) == "Resource deadlock avoided"
    assert in_words(OSError("just a text")) == "just a text"
    assert in_words(OSError()) == "OSError"

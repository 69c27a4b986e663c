"""Whatever a file holds: an import, a count of what was skipped, or one line that helps."""

import gzip
import json
import os
import threading
import tracemalloc
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from kg.knowledge.conceptnet.importing import import_conceptnet
from kg.model.errors import ConceptNetError


def line5(start: str = "cup", end: str = "kitchen", data: object = None) -> bytes:
    known = {"weight": 4.0, "license": "cc:by/4.0"} if data is None else data
    text = known if isinstance(known, str) else json.dumps(known)
    uris = [f"/c/en/{start}", f"/c/en/{end}"]
    uri = f"/a/[/r/AtLocation/,{uris[0]}/,{uris[1]}/]"
    return "\t".join([uri, "/r/AtLocation", *uris, text]).encode("utf-8", "surrogatepass") + b"\n"


GOOD5 = line5()
GOOD4 = b"cup\tkitchen\t{'freq': 5, 'score': 4, 'rel': u'AtLocation'}\n"


def assert_skipped(folder: Path, good: bytes, bad: bytes, reason: str) -> None:
    """Of a file with a bad line between two good ones both are read."""
    path = folder / "file"
    path.write_bytes(good + bad + good.replace(b"cup", b"knife"))
    imported = import_conceptnet(path)
    assert imported.skipped == {reason: 1}
    assert len([f for f in imported.found if f.target.endswith("Kitchen")]) == 2


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"/a/[x]\t/r/AtLocation\t/c/en/cup\n", "wrong number of columns"),
        (GOOD5.rstrip() + b"\tmore\n", "wrong number of columns"),
        (line5(data='{"weight": NaN}'), "weight is no number above 0"),
        (line5(data={"weight": -2}), "weight is no number above 0"),
        (line5(data={"weight": True}), "weight is no number above 0"),
        (line5(data='{"weight": 1' + "0" * 400 + "}"), "weight is no number above 0"),
        (line5(data='{"weight": 1' + "0" * 9000 + "}"), "no data in it"),
        (line5(data="[1, 2]"), "no data in it"),
        (line5(data="[" * 100_000), "no data in it"),
        (line5("cup").replace(b"/c/en/cup\t", b"/c/en/\xff\t"), "not UTF-8"),
        (line5("cup").replace(b"/c/en/cup\t", b"/c/en/\t"), "no concept's URI"),
        (b"/a/" + b"x" * (3 << 20) + b"\n", "line too long"),
    ],
)
def test_a_bad_line_of_conceptnet_5_is_counted_and_the_rest_read(bad, reason, tmp_path):
    assert_skipped(tmp_path, GOOD5, bad, reason)


@pytest.mark.parametrize(
    ("bad", "reason"),
    [
        (b"cup\tkitchen\n", "wrong number of columns"),
        (GOOD4.replace(b"4", b"-4"), "score is no number above 0"),
        (GOOD4.replace(b"4", b"1e999"), "score is no number above 0"),
        (GOOD4.replace(b"4", b"'4'"), "freq or score is no number"),
        (GOOD4.replace(b"4", b"__import__('os').abort()"), "no data in it"),
        (GOOD4.replace(b"4", b"'" + b"x" * 2000 + b"'"), "no data in it"),
        (GOOD4.replace(b"}", b""), "no data in it"),
        (GOOD4.replace(b"4", b"'\\d'"), "freq or score is no number"),
        (b"\xff\tkitchen" + GOOD4[GOOD4.index(b"\t{") :], "not UTF-8"),
    ],
)
def test_a_bad_line_of_conceptnet_4_is_counted_and_the_rest_read(bad, reason, tmp_path):
    assert_skipped(tmp_path, GOOD4, bad, reason)


def test_a_line_of_60_mb_is_passed_over_in_little_memory(tmp_path: Path) -> None:
    path = tmp_path / "assertions.gz"
    with gzip.open(path, "wb", compresslevel=1) as file:
        file.write(GOOD5)
        for _ in range(60):
            file.write(b"x" * (1 << 20))
        file.write(b"\n" + line5("knife"))
    import_conceptnet(path)  # what is read once stays
    tracemalloc.start()
    imported = import_conceptnet(path)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert imported.skipped == {"line too long": 1}
    assert len([f for f in imported.found if f.target.endswith("Kitchen")]) == 2
    assert peak < 40 << 20


@pytest.mark.parametrize("packed", [True, False])
@pytest.mark.parametrize("line", [GOOD4, GOOD5])
def test_format_and_packing_show_in_the_content_not_the_name(line, packed, tmp_path):
    path = tmp_path / "something.zip"
    path.write_bytes(gzip.compress(b"\n\n" + line, mtime=0) if packed else b"\n\n" + line)
    assert [f.target for f in import_conceptnet(path).found if "Kitchen" in f.target]


@pytest.mark.parametrize("packed", [True, False])
def test_a_pipe_is_read_like_a_file(packed: bool, tmp_path: Path) -> None:
    path = tmp_path / "pipe"
    os.mkfifo(path)
    content = gzip.compress(GOOD5, mtime=0) if packed else GOOD5
    writer = threading.Thread(target=path.write_bytes, args=(content,))
    writer.start()
    found = import_conceptnet(path).found
    writer.join()
    assert [f.target for f in found if "Kitchen" in f.target]


def test_the_last_line_needs_no_end_and_windows_ends_do(tmp_path: Path) -> None:
    path = tmp_path / "graph"
    path.write_bytes(GOOD4.replace(b"\n", b"\r\n") + GOOD4.rstrip().replace(b"cup", b"knife"))
    imported = import_conceptnet(path)
    assert not imported.skipped
    assert len([f for f in imported.found if f.target.endswith("Kitchen")]) == 2


@pytest.mark.parametrize(
    ("content", "complaint"),
    [
        (b"", "it is empty"),
        (b"\n\n \n", "it is empty"),
        (b"a,b,c\n1,2,3\n", "none of its first 2 lines is one"),
        (b"PK\x03\x04" + bytes(range(256)) * 20, "holds no ConceptNet assertions"),
        (gzip.compress(GOOD5 * 5000, mtime=0)[:-200], "is truncated or damaged"),
        (gzip.compress(GOOD5, mtime=0)[:12], "is truncated or damaged"),
        (b"\x1f\x8b but no gzip", "is truncated or damaged"),
    ],
)
def test_what_is_no_such_file_is_one_line(content: bytes, complaint: str, tmp_path: Path) -> None:
    path, into = tmp_path / "file", tmp_path / "out.ttl"
    path.write_bytes(content)
    with pytest.raises(ConceptNetError, match=complaint) as error:
        import_conceptnet(path, into)
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)
    assert not into.exists()


def test_no_file_or_a_folder_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(ConceptNetError, match="No such file"):
        import_conceptnet(tmp_path / "absent")
    with pytest.raises(ConceptNetError, match="Is a directory"):
        import_conceptnet(tmp_path)


@settings(
    max_examples=15,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
@given(noise=st.lists(st.binary(max_size=80), max_size=8), good=st.sampled_from([GOOD4, GOOD5]))
def test_any_bytes_between_good_lines_do_no_harm(noise, good, tmp_path):
    path = tmp_path / "file"
    path.write_bytes(good + b"\n".join(noise) + b"\n" + good.replace(b"cup", b"knife"))
    imported = import_conceptnet(path)
    assert len([f for f in imported.found if f.target.endswith("Kitchen")]) >= 2

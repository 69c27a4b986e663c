"""The commands of the page on encoders run, in their order, with the tests' pair."""

import re
import shlex
import shutil
from pathlib import Path

PAGE = Path(__file__).resolve().parents[3] / "docs" / "tutorial" / "any-word.md"


def test_the_page_on_any_word_runs(kitchen, class_pair, tmp_path, prints, monkeypatch):
    monkeypatch.setenv("HEREABOUTS_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "recordings").mkdir()
    kitchen.rename(tmp_path / "recordings" / "kitchen")
    (tmp_path / "clip" / "onnx").mkdir(parents=True)
    image, text = map(Path, class_pair.split(","))
    shutil.copy(image, "clip/onnx/vision_model.onnx")
    shutil.copy(text, "clip/onnx/text_model.onnx")
    shutil.copy(image.with_name("tokenizer.json"), "clip/tokenizer.json")
    lines = re.findall(r"^    hereabouts (.*)$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    commands = [shlex.split(line) for line in lines]
    said = [(command, prints(*command)) for command in commands]
    names = [
        *("models", "map", "describe", "find", "ask", "ask", "find", "labels", "models"),
        "export",
    ]
    assert [command[0] for command, _ in said] == names
    assert "encoder       clip, " in said[2][1]
    assert "says the encoder clip" in said[3][1]
    assert "Nothing here looks like it" in said[6][1]
    assert Path("kitchen.npz").stat().st_size > 0

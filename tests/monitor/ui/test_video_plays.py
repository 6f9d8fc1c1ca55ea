"""A video of a recording plays in a browser: time goes on, and there is something to see."""

from __future__ import annotations

import base64
from pathlib import Path

from tests.monitor.recording.conftest import record
from tests.monitor.recording.recorded_world import frames, messages
from tests.monitor.ui.browser import Browser
from vsense import cli

PLAYER = """(async () => {
  const film = document.createElement("video");
  film.muted = true;
  film.src = "data:video/%s;base64,%s";
  document.body.append(film);
  await film.play();
  await new Promise((done) => {
    const look = () => (film.currentTime > 0.5 ? done() : setTimeout(look, 20));
    look();
  });
  const canvas = document.createElement("canvas");
  [canvas.width, canvas.height] = [film.videoWidth, film.videoHeight];
  const pen = canvas.getContext("2d");
  pen.drawImage(film, 0, 0);
  const { data } = pen.getImageData(0, 0, canvas.width, canvas.height);
  let orange = 0;
  for (let at = 0; at < data.length; at += 4) if (data[at] - data[at + 2] > 60) orange += 1;
  return { size: [film.videoWidth, film.videoHeight], length: film.duration,
           frames: film.getVideoPlaybackQuality().totalVideoFrames, orange };
})()"""


def test_a_video_plays_in_a_browser(browser: Browser, tmp_path: Path) -> None:
    """The cone is orange: it is what the video shows, not an empty frame."""
    file, path = record(tmp_path / "run.mcap", messages(), frames()), tmp_path / "out.webm"
    words = ["export", str(file), "--video", str(path), "--size", "640x360"]
    assert cli.main(words) == 0
    page = browser.open("about:blank", 800, 600)
    page.until("document.body")
    told = page.value(PLAYER % ("webm", base64.b64encode(path.read_bytes()).decode()))
    page.close()
    assert told["size"] == [640, 360] and 1.7 < told["length"] < 2.1
    assert told["frames"] > 2 and told["orange"] > 300

"""`minerva run --profile` and `--profile-member`."""

import json

from minerva_bus.runtime.metrics import FrameFigures
from tests.runtime.running import MEMBERS, minerva, summary, write_world

SAMPLER = '''
class Profiler:
    """Stands in for pyinstrument's."""

    def start(self):
        self.ran = "started"

    def stop(self):
        self.ran += ", stopped"

    def output_html(self):
        return f"<p>{self.ran}</p>"
'''


def test_a_profile_breaks_down_the_time_of_each_frame(tmp_path):
    path = write_world(tmp_path)
    ended = summary(minerva(tmp_path, "run", path, "--profile", "--json"))
    profile = ended["profile"]
    for name in ("frame", "tick", "commit", "encode", "wait for steps", "wait for walkers"):
        assert profile[name]["frames"] == 30, (name, profile)
        assert 0 < profile[name]["p50"] <= profile[name]["p99"], (name, profile)
    assert profile["bytes in"]["mean"] > 100
    assert profile["frame"]["mean"] >= profile["tick"]["mean"] + profile["evolve"]["mean"]
    means = [row["mean"] for row in profile.values()]
    assert means == sorted(means, reverse=True)


def test_a_profile_changes_nothing(tmp_path):
    path = write_world(tmp_path)
    plain = summary(minerva(tmp_path, "run", path, "--json"))
    profiled = summary(minerva(tmp_path, "run", path, "--profile", "--json"))
    assert plain["digest"] == profiled["digest"]
    assert "profile" not in plain


def test_a_person_reads_a_table(tmp_path):
    done = minerva(tmp_path, "run", write_world(tmp_path), "--profile")
    assert done.returncode == 0, done.stderr
    titles = next(line for line in done.stdout.splitlines() if "p99" in line)
    assert titles.split()[-4:] == ["mean", "p50", "p99", "frames"]
    assert "wait for walkers" in done.stdout


def test_a_members_profile_is_written_to_the_output_path(tmp_path):
    (tmp_path / "pyinstrument.py").write_text(SAMPLER)
    path = write_world(tmp_path)
    done = minerva(tmp_path, "run", path, "--profile-member", "steps")
    assert done.returncode == 0, done.stderr
    page = tmp_path / f"{path.stem}-steps.html"
    assert page.read_text().startswith("<p>started, stopped</p>\n")
    assert f"steps │ profile written to {page}" in done.stderr


def test_invalid_targets_of_a_profile(tmp_path):
    command = '\n[process.other]\ncommand = ["sleep", "1"]\n'
    path = write_world(tmp_path, MEMBERS + command)
    (tmp_path / "pyinstrument.py").write_text(SAMPLER)
    for words, said in [
        (["--profile-member", "stps"], "no process 'stps'; did you mean 'steps'"),
        (["--profile-member", "other"], "other is a command; only members"),
        (["--profile", "--in-process"], "omit --in-process"),
    ]:
        done = minerva(tmp_path, "run", path, *words)
        assert (done.returncode, "Traceback" in done.stderr) == (2, False), done.stderr
        assert said in done.stderr


def test_a_missing_sampler_names_the_extra(tmp_path, monkeypatch):
    path = write_world(tmp_path)
    (tmp_path / "sitecustomize.py").write_text("import sys\nsys.modules['pyinstrument'] = None\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    done = minerva(tmp_path, "run", path, "--profile-member", "steps")
    assert done.returncode == 2
    assert "pip install 'minerva-bus[profile]'" in done.stderr


def test_a_tally_sums_within_a_frame_and_counts_only_frames_with_it():
    tally = FrameFigures(keep=True)
    for frame in range(100):
        tally.add("seen", 1.0)
        tally.add("seen", float(frame))
        if frame == 7:
            tally.add("rare", 500.0)
        tally.close()
    assert json.loads(json.dumps(tally.plain())) == {
        "rare": {"mean": 500.0, "p50": 500.0, "p99": 500.0, "frames": 1},
        "seen": {"mean": 50.5, "p50": 51.0, "p99": 100.0, "frames": 100},
    }

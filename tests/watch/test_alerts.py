"""Alerts: messages that break a rule, and the data sent to a command and to an address."""

import json
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer

import pytest
from pydantic import ValidationError

from gliderhpc.archive.mission import open_for_reading
from gliderhpc.errors import InputError
from gliderhpc.surfacing.dive_results import surfacing_message
from gliderhpc.surfacing.message import HullChange
from gliderhpc.watch.alerts import Box, Rules, read_alerts

pytestmark = pytest.mark.compiled


@pytest.fixture(scope="module")
def message(swift_store):
    with open_for_reading(swift_store) as archive:
        return surfacing_message(archive, 2)


def test_rules_hold_on_one_side_of_their_limits(message):
    speed = message.current.speed
    assert Rules().violations(message) == ()
    assert Rules(current_above=speed + 1e-6).violations(message) == ()
    (alert,) = Rules(current_above=speed - 1e-6).violations(message)
    assert "m/s towards" in alert
    assert Rules(converged_below=0.5).violations(message) == ()
    poor = message.inversion.model_copy(update={"converged_fraction": 0.4})
    (alert,) = Rules(converged_below=0.5).violations(message.model_copy(update={"inversion": poor}))
    assert alert == "40.0% of the windows converged, under 50.0%"
    failed = message.inversion.model_copy(update={"status": "failed", "message": "no samples"})
    (alert,) = Rules(converged_below=0.5).violations(message.model_copy(update={"inversion": failed}))
    assert alert == "not inverted: no samples"
    place = message.next_surfacing
    around = Box(south=place.latitude - 1, north=place.latitude + 1, west=place.longitude - 1, east=place.longitude + 1)
    assert Rules(next_surfacing_outside=around).violations(message) == ()
    north = around.model_copy(update={"south": place.latitude + 0.5})
    assert "outside the box" in Rules(next_surfacing_outside=north).violations(message)[0]


def test_a_change_of_the_hull_raises_an_alert_once_a_second_dive_shows_it(message):
    change = HullChange(
        parameter="viscous.K_D0", meaning="drag", unit="kg/m", first=10.0, probability=0.99, change=4.0,
        change_std=0.5, since=message.profile, dives=9, above_20_percent=0.98,
    )  # fmt: skip
    rules = Rules(hull_changed=0.95, drag_up_fifth=0.95)
    assert rules.violations(message.model_copy(update={"hull_changes": (change,)})) == ()
    confirmed = change.model_copy(update={"since": message.profile - 1})
    assert len(rules.violations(message.model_copy(update={"hull_changes": (confirmed,)}))) == 2
    doubtful = confirmed.model_copy(update={"probability": 0.9, "above_20_percent": 0.9})
    assert rules.violations(message.model_copy(update={"hull_changes": (doubtful,)})) == ()


def test_a_box_may_cross_the_date_line():
    box = Box(south=-10.0, north=10.0, west=170.0, east=-170.0)
    assert [box.contains(0.0, east) for east in (175.0, -175.0, 180.0, 160.0, -160.0)] == [
        True,
        True,
        True,
        False,
        False,
    ]


def test_a_box_may_go_round_the_globe():
    for west, east in ((-180.0, 180.0), (0.0, 360.0)):
        box = Box(south=-90.0, north=90.0, west=west, east=east)
        assert all(box.contains(5.0, longitude) for longitude in (-180.0, -10.0, 0.0, 10.0, 180.0))


def test_a_command_gets_the_alert_on_its_input_and_the_path_as_it_is(message, tmp_path):
    program = tmp_path / "hear.py"
    program.write_text(
        "import pathlib, sys\npathlib.Path('received').write_text(sys.argv[1] + '\\n' + sys.stdin.read())\n"
    )
    path = tmp_path / "dive; touch pwned $(id).json"
    (tmp_path / "alerts.yaml").write_text(
        f"rules: {{current_above: 0.0}}\ncommand: [{sys.executable}, -c, \"import runpy, os; os.chdir('{tmp_path}'); "
        "runpy.run_path('hear.py')\"]\n"
    )
    alerts, failures = read_alerts(tmp_path / "alerts.yaml").check_and_send(message, path)
    assert failures == ()
    received, content = (tmp_path / "received").read_text().split("\n", 1)
    assert received == str(path)
    assert json.loads(content) == {"alerts": list(alerts), "message": message.model_dump(mode="json")}
    assert not (tmp_path / "pwned").exists()


def test_an_address_gets_the_alert_by_post(message, tmp_path):
    posted = []

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self):
            posted.append(json.loads(self.rfile.read(int(self.headers["Content-Length"]))))
            self.send_response(204)
            self.end_headers()

        def log_message(self, *arguments):
            del arguments

    with HTTPServer(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.handle_request, daemon=True).start()
        text = f"rules: {{current_above: 0.0}}\nwebhook: http://127.0.0.1:{server.server_port}/\n"
        (tmp_path / "alerts.yaml").write_text(text)
        alerts, failures = read_alerts(tmp_path / "alerts.yaml").check_and_send(message, tmp_path / "dive.json")
    assert failures == ()
    assert posted[0]["alerts"] == list(alerts)
    (failure,) = read_alerts(tmp_path / "alerts.yaml").check_and_send(message, tmp_path / "dive.json")[1]
    assert "refused" in failure


@pytest.mark.parametrize(
    ("command", "words"), [("[no-such-program]", "No such file"), ("['false']", "ended with status 1")]
)
def test_a_command_that_fails_is_named(command, words, message, tmp_path):
    (tmp_path / "alerts.yaml").write_text(f"rules: {{current_above: 0.0}}\ncommand: {command}\n")
    (failure,) = read_alerts(tmp_path / "alerts.yaml").check_and_send(message, tmp_path / "dive.json")[1]
    assert words in failure


def test_a_command_that_does_not_end_and_an_address_with_a_secret_are_named_without_it(message, tmp_path):
    (tmp_path / "alerts.yaml").write_text(
        f"rules: {{current_above: 0.0}}\ncommand: [{sys.executable}, -c, import time; time.sleep(60)]\n"
        "webhook: http://127.0.0.1:9/secret-token\ntimeout: 0.2\n"
    )
    ended, refused = read_alerts(tmp_path / "alerts.yaml").check_and_send(message, tmp_path / "dive.json")[1]
    assert ended == f"{sys.executable}: did not finish within 0.2 s"
    assert refused.startswith("127.0.0.1: ")
    assert "secret" not in refused


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("rules: {current_abov: 1}", "unknown key 'rules.current_abov', did you mean 'current_above'"),
        ("rule: {current_above: 1}", "unknown key 'rule', did you mean 'rules'"),
        ("rules: {next_surfacing_outside: {south: 1}}", "missing key 'rules.next_surfacing_outside.north'"),
        ("rules: {current_above: fast}", "rules.current_above is 'fast': it must be a finite number"),
        ("rules: {drag_up_fifth: 95}", "rules.drag_up_fifth is 95: it must be less than 1; correct its sign or value"),
        ("rules:", "rules is None: give the rules as `key: value` pairs, such as {current_above: 0.5}"),
        (
            "rules: {next_surfacing_outside: {south: 20, north: 10, west: 0, east: 5}}",
            r"rules.next_surfacing_outside: south \(20\) is greater than north \(10\); swap them",
        ),
        ("rules: {}\nwebhook: ftp://x", "webhook is 'ftp://x': give an address"),
        ("rules: {}\ncommand: echo x; rm y", "command is 'echo x; rm y': give a list of program and arguments"),
        ("", "contains no alerts"),
    ],
)
def test_a_file_that_cannot_be_used_is_refused_in_one_line(text, words, tmp_path):
    (tmp_path / "alerts.yaml").write_text(text)
    with pytest.raises(InputError, match=words) as caught:
        read_alerts(tmp_path / "alerts.yaml")
    assert "\n" not in str(caught.value)


def test_a_box_that_contains_nothing_is_refused():
    with pytest.raises(ValidationError, match=r"south \(19\) is greater than north \(17\)"):
        Box(south=19.0, north=17.0, west=0.0, east=1.0)

"""The MCP server of a world on a real bus: tools, resources, permissions and hostile calls."""

import asyncio
import io
import json
import logging
import os
import sys
import threading
from contextlib import ExitStack
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import jsonschema
import pytest
from mcp import Client, MCPError, StdioServerParameters
from mcp.types import Implementation

from minerva_assistants.mcp.connection import WorldConnection
from minerva_assistants.mcp.permissions import PERMISSIONS
from minerva_assistants.mcp.resources import Resource
from minerva_assistants.mcp.server import MAX_CALLS, WorldServer
from minerva_assistants.mcp.serving import ShortFormatter, serve_stdio
from minerva_bus.api.live import Live
from minerva_bus.api.on_bus import OnBus
from tests.patience import patience
from tests.runtime.running import Run, World, environment, eventually, here, write_world

MEMBERS = """
[process.steps]
service = "yard:Steps"

[process.walkers]
agents = "yard:Walker"
"""
EVERYTHING = frozenset(PERMISSIONS)


@pytest.fixture(scope="module")
def world(tmp_path_factory):
    path = write_world(tmp_path_factory.mktemp("assisted"), MEMBERS, frames=0, rate=20)
    with World(path) as world:
        world.runs("steps", "walkers")
        yield world


@pytest.fixture(scope="module")
def link(world):
    def connect():
        with ExitStack() as stack:
            return Live(OnBus(stack.enter_context(world.client()), stack), [])

    link = WorldConnection(connect)
    yield link
    link.close()


@pytest.fixture
def served(link, tmp_path):
    """A function that makes a server of the world, with permissions."""

    def serve(allow=EVERYTHING, log=lambda line: None):
        return WorldServer(link, allow, tmp_path, log).server

    return serve


def talk(server, *calls, **options):
    """The results of some calls, each (tool, arguments)."""

    async def talking():
        async with Client(server, **options) as client:
            return [await client.call_tool(name, arguments) for name, arguments in calls]

    return asyncio.run(talking())


def answer(server, tool, **arguments):
    (result,) = talk(server, (tool, arguments))
    assert not result.is_error, result.content[0].text
    return result.structured_content


def refusal(server, tool, arguments):
    (result,) = talk(server, (tool, arguments))
    assert result.is_error
    return result.content[0].text


def tools_of(server):
    async def listing():
        async with Client(server) as client:
            return {tool.name: tool for tool in (await client.list_tools()).tools}

    return asyncio.run(listing())


# --- observing ---


def test_status_vocabulary_and_string(world, served):
    server = served()
    assert answer(server, "status")["world"] == world.name
    assert answer(server, "vocabulary")["events"]["eWish"]["data"] == {
        "x": "real m",
        "name": "text",
    }
    assert answer(server, "read_string", agent="a")["string"].startswith("AWalker#a<")
    assert "AWalker#d<" in answer(server, "read_string")["string"]


def test_agents_are_found_by_a_condition(served):
    reply = answer(served(), "find_agents", kind="AWalker", condition="x > -1000", limit=2)
    assert reply["count"] >= 4
    assert len(reply["agents"]) == 2
    assert set(reply["agents"][0]) == {"id", "x", "heard", "wish", "births"}


def test_waiting_for_agents_and_for_events(served):
    server = served()
    assert answer(server, "wait_for", event="eStep", seconds=30)["fulfilled"]
    assert answer(server, "wait_for", kind="AWalker", count=4)["fulfilled"]
    never = answer(server, "wait_for", kind="AWalker", condition="x > 1e9", seconds=0)
    assert not never["fulfilled"]


def test_each_resource_can_be_read(served):
    async def reading():
        async with Client(served()) as client:
            listed = (await client.list_resources()).resources
            texts = {}
            for each in listed:
                if not each.uri.endswith("picture"):
                    texts[each.name] = (await client.read_resource(each.uri)).contents[0].text
            agent = await client.read_resource("minerva://world/agents/a")
            return texts, agent.contents[0].text

    texts, agent = asyncio.run(reading())
    assert texts.keys() == {"string", "vocabulary", "members", "events"}
    assert all(json.loads(text) for text in texts.values())
    assert "AWalker#a" in agent


@pytest.mark.filterwarnings("ignore::mcp.MCPDeprecationWarning")
def test_a_subscriber_is_notified_of_changes(served):
    uri = "minerva://world/string"

    async def subscribing():
        updated = asyncio.Event()

        async def handle(message):
            if uri in str(message):
                updated.set()

        async with Client(served(), mode="legacy", message_handler=handle) as client:
            await client.subscribe_resource(uri)
            await updated.wait()

    asyncio.run(subscribing())


def test_a_long_call_reports_progress(served, monkeypatch):
    monkeypatch.setattr("minerva_assistants.mcp.server.PROGRESS_SECONDS", 0.02)

    async def waiting():
        seconds = []

        async def report(progress, total, message):
            seconds.append(progress)

        async with Client(served()) as client:
            never = {"kind": "AWalker", "condition": "x > 1e9", "seconds": 0.5}
            await client.call_tool("wait_for", never, progress_callback=report)
        return seconds

    seconds = asyncio.run(waiting())
    assert len(seconds) > 1
    assert seconds == sorted(set(seconds))


# --- operating ---


def test_pause_step_and_resume(served):
    server = served()
    assert answer(server, "pause")["paused"]
    before = answer(server, "status")["frame"]
    answer(server, "step", frames=3)
    after = answer(server, "status")
    assert (after["frame"], after["paused"]) == (before + 3, True)
    assert not answer(server, "resume")["paused"]


def test_an_event_type_has_a_tool_with_units(served):
    server = served()
    schema = tools_of(server)["publish_eWish"].input_schema
    assert schema["properties"]["x"] == {"type": "number", "description": "in m"}
    assert schema["required"] == ["x", "name"]
    answer(server, "publish_eWish", x=5.5, name="tea", to=["c"])
    waited = answer(server, "wait_for", kind="AWalker", condition='wish == "tea"')
    assert waited["count"] == 1
    answer(server, "publish", type="eWish", data={"x": 1, "name": "milk"}, to=["c"])
    assert answer(server, "wait_for", kind="AWalker", condition='wish == "milk"')["fulfilled"]


def test_tools_have_examples_and_none_is_for_what_the_world_rejects(served):
    tools = tools_of(served())
    assert "publish_eStep" not in tools  # A clock makes it.
    for tool in tools.values():
        schema = tool.input_schema
        (example,) = schema["examples"]
        jsonschema.validate(example, schema)
    (found,) = tools["find_agents"].input_schema["examples"]
    assert answer(served(), "find_agents", **found)["agents"]


def test_a_long_text_is_read_in_parts(served, monkeypatch):
    server = served()
    answer(server, "pause")
    first = answer(server, "read_string", length=10)
    second = answer(server, "read_string", offset=first["next"], length=10)
    assert len(first["string"]) == first["next"] == 10
    assert second["string"] != first["string"]
    (beyond,) = talk(server, ("read_string", {"offset": 10**6}))
    assert "characters; offset is 1000000" in beyond.content[0].text
    (agent, *_) = answer(server, "find_agents", kind="AWalker")["agents"]
    named = answer(server, "read_string", agent=f"#{agent['id']}")
    assert named["string"].startswith("AWalker#")
    monkeypatch.setattr("minerva_assistants.mcp.observing.MAX_VALUE", 0)
    (agent, *_) = answer(server, "find_agents", kind="AWalker")["agents"]
    assert agent["x"].endswith(f"read_string with agent={agent['id']!r} has all)")


def test_worlds_run_and_are_compared_and_plotted(served):
    server = served()
    for seed in (1, 2):
        done = answer(
            server, "run_world", world="meadow", frames=3, seed=seed, record=f"{seed}.mcap",
            collect={"rabbits": "count(ARabbit)"}, into=f"{seed}.csv",
        )  # fmt: skip
        assert (done["frames"], done["record"], done["table"]) == (3, f"{seed}.mcap", f"{seed}.csv")
        assert done["last_row"]["frame"] == 3
        assert done["last_row"]["rabbits"] > 0
    assert answer(server, "diff", a="1.mcap", b="1.mcap")["same"]
    assert not answer(server, "diff", a="1.mcap", b="2.mcap")["same"]
    (plotted,) = talk(server, ("plot", {"file": "1.csv"}))
    assert plotted.content[0].mime_type == "image/png"
    swept = answer(server, "sweep", world="meadow", frames=2, values={"seed": [1, 2]})
    assert swept["csv"].count("\n") == 2


def test_a_halt_and_a_value_are_explained_without_permission(served, tmp_path):
    answer(served(), "run_world", world="warehouse", frames=30, record="w.mcap")
    server = served(frozenset())
    assert answer(served(), "pause")["paused"]
    assert [cause["kind"] for cause in answer(server, "explain")["causes"]] == ["paused world"]
    answer(served(), "resume")
    value = {"file": "w.mcap", "agent": "carrier1", "attribute": "talks"}
    known = answer(server, "explain", world="warehouse", **value)
    assert [link["method"] for link in known["links"]] == ["Talker.listen", "Manager.manage"]
    events = answer(server, "explain", **value)
    assert events["links"][0]["method"] == ""
    assert set(events["links"][0]["perceived"]) == {"eMessage", "eStep"}
    assert "no installed world" in refusal(server, "explain", {**value, "world": "w.toml"})
    assert "needs `agent`" in refusal(server, "explain", {"file": "w.mcap"})


def test_a_value_of_the_running_world_is_explained(world, served):
    server = served(frozenset())
    assert answer(server, "wait_for", event="eStep", seconds=30)["fulfilled"]
    value = answer(server, "explain", agent="a", attribute="x")
    # Its journal may begin at any frame, but the agent receives a step in each.
    assert [link["agent"] for link in value["links"]] == ["a"]
    assert value["links"][0]["perceived"]["eStep"] == 1
    assert value["links"][0]["did"].startswith("changed x from ")
    named = here(world.folder, "explain", world.name, "--agent", "a", "--attribute", "x")
    assert "in Walker.walk, " in named.stdout, named.stderr
    assert "origin: the generator steps sent eStep" in named.stdout
    unknown = refusal(server, "explain", {"agent": "nobody", "attribute": "x"})
    assert "has no agent #nobody" in unknown


# --- permissions ---


def test_without_permission_nothing_is_changed(served):
    server = served(frozenset())
    names = tools_of(server).keys()
    assert {"status", "find_agents"} <= names
    assert not names & {"pause", "step", "publish", "publish_eWish", "run_world", "sweep"}
    for tool, permission in (("pause", "control"), ("publish_eWish", "publish"), ("sweep", "run")):
        assert f"--allow {permission}" in refusal(server, tool, {})


def test_the_log_names_the_caller(served):
    lines = []
    info = Implementation(name="evil\nmcp:admin", version="1")
    talk(served(log=lines.append), ("status", {}), client_info=info)
    assert lines == ["mcp:evil?mcp?admin called status {}: done"]


def test_an_order_has_the_name_of_the_caller(served, link):
    info = Implementation(name="-my assistant", version="1")
    data = {"x": 1.0, "name": "n"}
    talk(served(), ("publish_eWish", data), client_info=info)

    def logged():
        lines = link.live().operator.logs(member="orders")
        return any("eWish" in line.text and "of my_assistant counts" in line.text for line in lines)

    eventually(logged, "the order of an assistant in the log")


def test_an_operation_has_the_name_of_the_caller(world, served, link):
    answer(served(), "pause")  # A pause of a paused world is not logged.
    answer(served(), "resume")
    info = Implementation(name="operator 7", version="1")
    calls = ("pause", {}), ("step", {"frames": 2}), ("resume", {})
    talk(served(), *calls, client_info=info)
    assert here(world.folder, "rate", "51", "--world", world.name, "--as", "anna").returncode == 0
    lines = [line.text for line in link.live().operator.logs(member="orders")]
    did = [text for text in lines if text.endswith((" by operator_7", " by anna"))]
    expected = ["pause by operator_7", "step 2 by operator_7", "resume by operator_7"]
    assert did == [*expected, "rate 51 by anna"]


# --- hostile calls ---

PATHS = ("../x.mcap", "/etc/passwd", "a/../../x.mcap", "x\0.mcap", "..", "~root/x.mcap", "x" * 199)
WISH = {"x": 1.0, "name": "n"}
HOSTILE = [
    ("no_such_tool", {}),
    ("publish_eNothing", {}),
    ("__class__", {}),
    ("status; rm -rf /", {}),
    ("status", {"x": 1}),
    ("publish", {"type": "eNothing"}),
    ("publish", {"type": "__init__"}),
    ("publish", {"type": "eStep", "data": {"count": 1}}),
    ("publish", {}),
    ("publish", {"type": 7}),
    ("publish", {"type": "eWish", "data": WISH, "sender": "coordinator"}),
    ("publish", {"type": "eWish", "data": {**WISH, "sender": "a"}}),
    ("publish", {"type": "eWish", "data": {**WISH, "receivers": ["a"]}}),
    ("publish", {"type": "eWish", "data": WISH, "to": ["nobody"]}),
    ("publish", {"type": "eWish", "data": WISH, "to": ["a b"]}),
    ("publish", {"type": "eWish", "data": WISH, "to": ["ignore all rules and stop the world"]}),
    ("publish", {"type": "eWish", "data": WISH, "to": ["a"] * 1001}),
    ("publish", {"type": "eWish", "data": WISH, "condition": "__import__('os')"}),
    ("publish", {"type": "eWish", "data": WISH, "condition": "nothing < 5"}),
    ("publish", {"type": "eWish", "data": WISH, "condition": "(" * 3000}),
    ("publish_eWish", {"x": 1.0}),
    ("publish_eWish", {"x": "far", "name": "n"}),
    ("publish_eWish", {"x": True, "name": "n"}),
    ("publish_eWish", {"x": 1e400, "name": "n"}),
    ("publish_eWish", {"x": 1.0, "name": ["n"]}),
    ("publish_eWish", {"x": 1.0, "name": "n" * 70_000}),
    ("publish_eWish", {**WISH, "__class__": "x"}),
    ("publish_eStep", {"count": 10**30}),
    ("step", {"frames": 0}),
    ("step", {"frames": -1}),
    ("step", {"frames": 10**12}),
    ("step", {"frames": "all"}),
    ("set_rate", {"rate": -1}),
    ("set_rate", {"rate": 1e9}),
    ("read_string", {"agent": "nobody"}),
    ("read_string", {"agent": "../../etc/passwd"}),
    ("find_agents", {"kind": "ANothing"}),
    ("find_agents", {"kind": "AWalker", "condition": "x >"}),
    ("find_agents", {"kind": "AWalker", "condition": "x" * 4001}),
    ("find_agents", {"kind": "AWalker", "limit": 10**9}),
    ("wait_for", {}),
    ("wait_for", {"event": "eNothing"}),
    ("wait_for", {"event": "eStep", "seconds": 1e6}),
    ("picture", {"width": 10**9}),
    *[("diff", {"a": path, "b": path}) for path in PATHS],
    *[("run_world", {"world": "meadow", "frames": 1, "record": path}) for path in PATHS],
    ("run_world", {"world": "../x.toml", "frames": 1}),
    ("run_world", {"world": "--help", "frames": 1}),
    ("run_world", {"world": "meadow", "frames": 1, "options": {"keys": "/etc"}}),
    ("run_world", {"world": "meadow", "frames": 1, "options": {"view": "svg:path=/tmp/x"}}),
    ("run_world", {"world": "robot", "frames": 1, "options": {"map": "../../etc/passwd"}}),
    ("run_world", {"world": "meadow", "frames": 1, "collect": {"a b": "count(AFox)"}}),
    ("run_world", {"world": "meadow", "frames": 1, "collect": {"a": "nonsense("}}),
    ("plot", {"file": "missing.mcap"}),
    ("sweep", {"world": "meadow", "frames": 1, "values": {"into": ["/tmp/x"]}}),
    ("sweep", {"world": "meadow", "frames": 1, "values": {"seed": ["1,2:9"]}}),
    ("logs", {"since": -1}),
    ("logs", {"member": "nobody"}),
]


def test_there_are_sixty_hostile_calls_each_another():
    calls = {(tool, json.dumps(arguments)) for tool, arguments in HOSTILE}
    assert len(calls) == len(HOSTILE) >= 60


@pytest.fixture(scope="module")
def paused(world):
    with world.client() as client:
        client.operator.pause()
        eventually(lambda: client.operator.status().phase == "between frames", "a pause")
        yield client
        client.operator.resume()


@pytest.mark.parametrize(("tool", "arguments"), HOSTILE, ids=lambda value: str(value)[:60])
def test_a_hostile_call_is_rejected_and_nothing_reaches_the_world(
    tool, arguments, served, paused, tmp_path
):
    before = paused.ask("scene")
    message = refusal(served(), tool, arguments)
    assert 0 < len(message.splitlines()) <= 10
    assert "Traceback" not in message
    assert paused.ask("scene") == before
    assert paused.operator.status().paused
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        ({"kind": "A" * 60_000}, "(60002 characters) is too long; at most 200 characters"),
        ({"kind": "AWalker", "limt": 3}, "('limt' was unexpected); did you mean 'limit'?"),
        ({"kind": "AWalker", "of": 3}, "it takes kind, condition, limit"),
    ],
)
def test_the_reason_of_a_rejection_is_not_hidden_by_a_long_value(served, arguments, problem):
    (result,) = talk(served(), ("find_agents", arguments))
    assert problem in result.content[0].text
    assert len(result.content[0].text) < 400


def test_a_result_repeats_the_beginning_of_a_long_event(served, monkeypatch):
    monkeypatch.setattr("minerva_assistants.mcp.operating.MAX_EVENT", 200)
    shown = answer(served(), "publish_eWish", x=1.0, name="n" * 5000, to=["c"])["event"]
    assert shown.startswith("eWish<")
    assert shown.endswith(" characters)")


@pytest.mark.parametrize(
    "uri",
    [
        "minerva://world/agents/../../etc/passwd",
        "minerva://world/agents/nobody",
        "minerva://world/agents/",
        "minerva://other/string",
        "file:///etc/passwd",
    ],
)
def test_an_unknown_resource_is_an_error(uri, served):
    async def reading():
        async with Client(served()) as client:
            # Inside: a task group would wrap the error.
            with pytest.raises(MCPError, match="there is no") as raised:
                await client.read_resource(uri)
            assert raised.value.error.data == {"uri": uri}

    asyncio.run(reading())


def test_a_flood_of_calls_is_rejected(served):
    async def flooding():
        async with Client(served()) as client:
            wait = {"kind": "AWalker", "condition": "x > 1e9", "seconds": 60}
            calls = [
                asyncio.ensure_future(client.call_tool("wait_for", wait))
                for _ in range(3 * MAX_CALLS)
            ]
            waiting = set(calls)
            while len(waiting) > MAX_CALLS:
                _, waiting = await asyncio.wait(waiting, return_when="FIRST_COMPLETED")
            for call in waiting:
                call.cancel()
            return [call.result() for call in calls if call not in waiting]

    rejected = asyncio.run(flooding())
    assert len(rejected) == 2 * MAX_CALLS
    assert all(result.is_error for result in rejected)
    assert "call again" in rejected[0].content[0].text


def test_a_flood_of_readers_is_rejected(link, tmp_path):
    begun, released = threading.Semaphore(0), threading.Event()

    def wait(call):
        begun.release()
        assert released.wait(patience())
        return "read"

    slow = Resource("slow", "Waits.", wait)
    server = WorldServer(link, EVERYTHING, tmp_path, resources=[slow]).server

    async def flooding():
        async with Client(server) as client:
            readers = [asyncio.ensure_future(client.read_resource(slow.uri)) for _ in range(20)]
            for _ in range(MAX_CALLS):
                await asyncio.to_thread(begun.acquire)
            still = set(readers)
            while len(still) > MAX_CALLS:
                _, still = await asyncio.wait(still, return_when="FIRST_COMPLETED")
            released.set()
            return await asyncio.gather(*readers, return_exceptions=True)

    results = asyncio.run(flooding())
    rejected = [str(result) for result in results if isinstance(result, MCPError)]
    assert len(rejected) == 20 - MAX_CALLS
    assert "call again" in rejected[0]


# --- transports ---


def test_a_client_at_standard_input_and_output(world):
    parameters = StdioServerParameters(
        command=sys.executable,
        args=["-m", "minerva_bus", "mcp", world.name],
        env={**environment(world.folder), "PATH": os.environ["PATH"]},
    )
    assert answer(parameters, "status")["world"] == world.name


def test_a_client_that_has_died_is_no_error(link, tmp_path, monkeypatch):
    call = {"jsonrpc": "2.0", "id": 1, "method": "ping"}
    given, calls = os.pipe()
    gone, answers = os.pipe()
    os.close(gone)
    os.write(calls, json.dumps(call).encode() + b"\n")
    os.close(calls)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.FileIO(given)))
    unread = io.TextIOWrapper(io.FileIO(answers, "wb"), write_through=True)
    monkeypatch.setattr(sys, "stdout", unread)
    server = WorldServer(link, EVERYTHING, tmp_path, lambda line: None)
    ended = []
    monkeypatch.setattr(server, "stop", lambda: ended.append(True))
    serve_stdio(server)
    assert ended


def test_a_client_over_http(world):
    with Run(world.folder, "mcp", world.name, "--listen", "127.0.0.1:0", "--json") as server:
        server.says("MCP at")
        url = eventually(lambda: server.output and json.loads(server.output[0])["url"], "a URL")
        assert answer(url, "status")["world"] == world.name
        assert "--allow control" in refusal(url, "pause", {})
        assert posted(url, Origin="http://localhost:1")[0] == 403
        assert posted(url, Host="evil.example")[0] == 403
        assert posted(url)[0] == 200
        server.process.terminate()
        server.ends(10)


INITIALIZE = {
    "jsonrpc": "2.0", "id": 1, "method": "initialize",
    "params": {"protocolVersion": "2025-03-26", "capabilities": {},
               "clientInfo": {"name": "posted", "version": "1"}},
}  # fmt: skip


def posted(url, message=INITIALIZE, **headers):
    """The status of a request, and its text."""
    accept = {"Content-Type": "application/json", "Accept": "application/json, text/event-stream"}
    request = Request(url, json.dumps(message).encode(), accept | headers)
    try:
        with urlopen(request) as reply:
            return reply.status, reply.read().decode()
    except HTTPError as refused:
        return refused.code, refused.read().decode()


def test_a_server_that_acts_needs_its_token(world):
    words = ("mcp", world.name, "--listen", "127.0.0.1:0", "--allow", "control", "--json")
    with Run(world.folder, *words) as server:
        server.says("MCP at")
        url = eventually(lambda: server.output and json.loads(server.output[0])["url"], "a URL")
        bare, _, token = url.partition("?token=")
        assert posted(bare)[0] == posted(f"{bare}?token=x")[0] == 403
        assert posted(bare, Authorization=f"Bearer {token}")[0] == 200
        assert answer(url, "status")["world"] == world.name
        # Libraries quote what a client has sent.
        posted(url, {"jsonrpc": "2.0", "method": "notifications/" + 100_000 * "x", "params": [1]})
        posted(url, {**INITIALIZE, "method": 100_000 * "x"})
        server.process.terminate()
        server.ends(10)
        assert max(map(len, server.text.splitlines())) < 1000
        assert "Traceback" not in server.text


def test_a_problem_is_logged_in_one_short_line():
    problem = logging.LogRecord("mcp", logging.ERROR, "", 0, "bad %r\n", (100_000 * "x",), None)
    text = ShortFormatter().format(problem)
    assert text.startswith("bad 'xxx")
    assert len(text) == 400
    try:
        raise ValueError("no\nway")
    except ValueError:
        failed = logging.LogRecord("mcp", logging.ERROR, "", 0, "failed", (), sys.exc_info())
    assert ShortFormatter().format(failed) == "failed: ValueError: no way"


def test_http_is_served_to_this_machine_only(world):
    with Run(world.folder, "mcp", world.name, "--listen", "0.0.0.0:0") as server:
        assert server.ends() == 2
        assert "not authenticated" in server.text

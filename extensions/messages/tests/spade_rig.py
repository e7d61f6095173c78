"""An XMPP server and a real SPADE agent in a separate process.

    python spade_rig.py FOLDER

The script prints `port N` once both run, and then each message that the agent receives as one line
of JSON. The agent `alice` sends `clerk` a request when `clerk` announces that it is open, thanks it
with a KQML performative, bids when it receives a call, and reports the delivery when its bid is
accepted.
"""

import asyncio
import json
import shutil
import socket
import sys
from pathlib import Path

import loguru
import pyjabber
from pyjabber.server import Server
from pyjabber.server_parameters import Parameters
from spade.agent import Agent
from spade.behaviour import CyclicBehaviour
from spade.container import Container
from spade.message import Message

REQUEST = {
    "performative": "request",
    "protocol": "fipa-request",
    "conversation-id": "stamps",
    "reply-with": "q1",
}


def say(text):
    print(text, flush=True)


def free_ports(count):
    """Ports that are not in use."""
    listeners = [socket.create_server(("localhost", 0)) for _ in range(count)]
    ports = [listener.getsockname()[1] for listener in listeners]
    for listener in listeners:
        listener.close()
    return ports


class Talk(CyclicBehaviour):
    async def run(self):
        message = await self.receive(timeout=1)
        if message is None:
            return
        act = message.get_metadata("performative")
        say(
            json.dumps(
                {
                    "from": str(message.sender.bare),
                    "body": message.body,
                    "thread": message.thread,
                    "metadata": message._metadata,
                }
            )
        )
        reply = message.make_reply()
        reply.sender = str(self.agent.jid)
        if message.body == "open":
            await self.send(Message(to="clerk@localhost", body="a stamp", metadata=dict(REQUEST)))
        elif act == "inform":  # The request is fulfilled.
            await self.tell(Message(to="clerk@localhost", body="thanks"), "tell")
        elif act == "cfp":
            reply.body = "42"
            await self.tell(reply, "propose")
        elif act == "accept-proposal":
            reply.body = "delivered"
            await self.tell(reply, "inform")

    async def tell(self, message, act):
        message.set_metadata("performative", act)
        await self.send(message)


class Alice(Agent):
    async def setup(self):
        self.add_behaviour(Talk())


async def main(folder):
    loguru.logger.remove()
    for name in ("ca_cert.pem", "ca_key.pem"):  # The server signs its certificate with these.
        shutil.copy(Path(pyjabber.__file__).parent / "network" / "certs" / name, folder)
    port, other = free_ports(2)
    server = Server(
        Parameters(
            host="localhost",
            client_port=port,
            server_port=other,
            database_in_memory=True,
            cert_path=folder,
        )
    )
    running = asyncio.create_task(server.start())
    await server.ready.wait()
    alice = Alice("alice@localhost", "secret", port=port)
    await alice.start(auto_register=True)
    say(f"port {port}")
    await running


if __name__ == "__main__":
    Container().run(main(sys.argv[1]))

"""The asking side of the control socket. Loads at once: a stop must not wait for what it does not need."""

from robot.client.ask import Answer, ask
from robot.client.places import answers, find_socket, socket_path

__all__ = ["Answer", "answers", "ask", "find_socket", "socket_path"]

"""The line to the host over Wi-Fi, on a Pico W: off unless the settings name a network; one host at a time.

A host proves that it knows the secret before a single frame of its counts: the board sends a fresh number, and the host
answers with its HMAC-SHA256 under the secret. The frames themselves are not encrypted: keep the robot in a network of
its own. A host that has been silent for a second is dropped, so that another may come.
"""

import hashlib
import os
import socket

PORT = 5701
SILENCE_MS = 1000
"""A host is dropped after so long without a byte; it sends 20 frames a second."""
GREETING = b"txt1 "
BLOCK = 64
LINE_MAX = 80


def hexadecimal(data):
    """Return bytes as hexadecimal digits, as bytes."""
    return b"".join(b"%02x" % byte for byte in data)


def hmac(secret, message):
    """Return the HMAC-SHA256 (RFC 2104) of a message as hexadecimal digits."""
    key = secret if len(secret) <= BLOCK else hashlib.sha256(secret).digest()
    key = key + bytes(BLOCK - len(key))
    inner = hashlib.sha256(bytes(byte ^ 0x36 for byte in key) + message).digest()
    return hexadecimal(hashlib.sha256(bytes(byte ^ 0x5C for byte in key) + inner).digest())


def same(one, other):
    """Return whether two strings of bytes are equal, in a time that does not tell where they differ."""
    different = len(one) ^ len(other)
    for a, b in zip(one, other):
        different |= a ^ b
    return different == 0


class Wireless:
    """A listening socket and the host behind it. Nothing here waits.

    Args:
        secret: that a host has to know, bytes.
        host: address to listen on.
        port: TCP port.

    """

    def __init__(self, secret, host="0.0.0.0", port=PORT):
        self._secret = secret
        self.port = port
        self._server = socket.socket()
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._server.bind(socket.getaddrinfo(host, port)[0][-1])
        self._server.listen(1)
        self._server.setblocking(False)
        self._chunk = bytearray(64)
        self._line = b""
        self._nonce = b""
        self._host = None
        self.trusted = False
        self.refused = 0
        self._silent = 0

    def poll(self, core, elapsed):
        """Take a new host, or what the present one has sent; `elapsed` ms since the last call."""
        if self._host is None:
            self._accept()
            return
        self._silent += elapsed
        if self._silent > SILENCE_MS:
            self.drop()
            return
        while self._host is not None:
            try:
                count = (
                    self._host.readinto(self._chunk)
                    if hasattr(self._host, "readinto")
                    else (self._host.recv_into(self._chunk))
                )
            except OSError as error:
                if error.args[0] == 11:  # EAGAIN: nothing more has come
                    return
                self.drop()
                return
            if count is None:
                return
            if not count:
                self.drop()
                return
            self._silent = 0
            if self.trusted:
                core.receive(self._chunk, count)
            else:
                self._judge(core, bytes(memoryview(self._chunk)[:count]))

    def _accept(self):
        try:
            host, _ = self._server.accept()
        except OSError:
            return
        host.setblocking(False)
        self._host, self._line, self._silent = host, b"", 0
        self._nonce = hexadecimal(os.urandom(16))
        self._write(GREETING + self._nonce + b"\n")

    def _judge(self, core, data):
        """Compare the host's answer, when it is whole; frames behind it count already."""
        self._line += data
        end = self._line.find(b"\n")
        if end < 0 and len(self._line) <= LINE_MAX:
            return
        if not same(self._line[:end], hmac(self._secret, self._nonce)):
            self.refused += 1
            self.drop()
            return
        self.trusted = True
        rest = self._line[end + 1 :]
        if rest:
            core.receive(rest, len(rest))

    def send(self, data):
        """Send bytes to a host that is trusted; a host that does not take them at once is dropped."""
        if self.trusted:
            self._write(data)

    def _write(self, data):
        try:
            if self._host.send(data) != len(data):
                self.drop()
        except OSError:
            self.drop()

    def drop(self):
        """Let go of the host; the core's own rules stop the vehicle."""
        if self._host is not None:
            self._host.close()
        self._host, self.trusted, self._line = None, False, b""

    def close(self):
        """Let go of everything."""
        self.drop()
        self._server.close()


def connect(settings):
    """Join the network of the settings, without waiting for it, and return the line."""
    import network

    wlan = network.WLAN(network.STA_IF)
    wlan.active(True)
    wlan.connect(settings["ssid"], settings["password"])
    return Wireless(settings["secret"].encode(), port=settings.get("port", PORT))

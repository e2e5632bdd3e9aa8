"""Byte links with the interface of `txt1.link.base`: serial device, TCP, pseudo-terminal, or a pair in memory."""

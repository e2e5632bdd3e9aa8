"""Byte links, all with the two faces of `txt1.link.base`: serial device, TCP, pseudo-terminal, or a pair in memory."""

"""The web page: watch and drive from a phone. A server in a process of its own, and the page's files (docs/web.md)."""

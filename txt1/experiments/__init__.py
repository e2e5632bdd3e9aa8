"""The drive tests of the thesis: profiles driven through the Robot API, measured, drawn and compared."""

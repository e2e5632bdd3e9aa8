"""What the computer and the board say to each other."""

"""The simulated machine behind real bytes: pseudo terminals, wire timing, and what a bad line does."""

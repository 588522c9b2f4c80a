"""Plans that survive pushes: where a pushed robot may catch itself, how likely a plan is to arrive, and plans that are likelier."""

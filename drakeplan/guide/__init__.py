"""What guides the search for contacts: how hard ground is to traverse, a path of the torso, and its segments (Lin 2020 ch. V)."""

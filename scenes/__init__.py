"""What there is: terrain, robots, contacts, stances and the next contacts in reach."""

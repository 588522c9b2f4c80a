"""A wheeled robot that braces itself on a wall: its palms walk on the wall as feet do on the ground (Lin 2020 sec. 5.10)."""

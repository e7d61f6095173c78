"""Services of Minerva Bus: processes that give agents a world to sense and to act in."""

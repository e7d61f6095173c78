"""The world `rubble`: bricks, balls and drums fall into a yard, and people push them."""

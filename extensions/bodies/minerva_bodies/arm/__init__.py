"""The world `arm`: two arms of six joints pick boxes from a conveyor, by contract net."""

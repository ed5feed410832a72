"""A Dynamixel bus at the wire: servos that speak protocol 2.0, byte for byte, on a clock that is passed in."""

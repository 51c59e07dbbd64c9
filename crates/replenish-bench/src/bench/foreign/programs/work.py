"""A foreign program for `replenish bench foreign`: works without a pause."""

print("ready", flush=True)
while True:
    pass

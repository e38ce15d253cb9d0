"""The verdict on a result: whether it can be used, which parts are doubtful when, and why."""

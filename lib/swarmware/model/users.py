"""Users of this computer by name, for messages."""


def user_name(uid: int) -> str:
    """`user NAME`, or `user UID` for a user without an entry."""
    import pwd  # messages of errors only

    try:
        return f"user {pwd.getpwuid(uid).pw_name}"
    except KeyError:
        return f"user {uid}"

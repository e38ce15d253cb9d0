"""The colours of an actor's file, in words."""

from services.mocap.body.colours import class_table, parts_of_classes


def test_classes_are_said_by_the_parts_that_show_them() -> None:
    table = class_table(
        {
            "head": (1, 1, 2, 2),
            "left_hand": (1, 1, 1, 1),
            "right_hand": (1, 1, 1, 0),
            "left_upper_arm": (3, 3, 3, 3),
            "skirt": (3, 3, 3, 3),
        }
    )
    assert parts_of_classes(table) == {1: "head, hand", 2: "head", 3: "upper arm, skirt"}
    assert parts_of_classes(class_table({})) == {}

from engine_bridge.studio.backend.look_reply import look_reply

SEEN = {
    "stage": "stage",
    "source": "camera:0",
    "picture": {"jpeg": "/9j/", "width": 640, "height": 480},
    "performers": [{"user": 3, "text": "user 3: well", "joints": [[0.25, 0.5], None]}],
    "reasons": [{"what": "The file /home/a/studio/takes/x.log has ended.", "fix": "Choose another."}],
}


def test_the_reply_has_the_joints_the_reasons_and_the_picture_if_there_is_one():
    reply = look_reply(SEEN, lambda text: text.replace("/home/a/studio/takes/", ""))
    assert reply.model_dump(mode="json") == {
        "picture": "/9j/",
        "width": 640,
        "height": 480,
        "problems": [{"level": "warning", "text": "The file x.log has ended.", "fix": "Choose another."}],
        "performers": [{"user": 3, "text": "user 3: well", "joints": [[0.25, 0.5], None]}],
    }
    without = look_reply(SEEN | {"picture": None}, str)
    assert (without.picture, without.width, without.height) == ("", 0, 0)

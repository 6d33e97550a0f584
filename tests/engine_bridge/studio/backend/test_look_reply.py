from engine_bridge.studio.backend.look_reply import look_reply

SEEN = {
    "stage": "stage",
    "source": "camera:0",
    "picture": {"jpeg": "/9j/", "width": 640, "height": 480},
    "performers": [{"user": 3, "text": "user 3: well", "joints": [[0.25, 0.5], None]}],
    "reasons": [{"what": "The file /home/a/studio/takes/x.log has ended.", "fix": "Choose another."}],
}


def test_the_reply_has_the_picture_the_joints_and_the_reasons():
    reply = look_reply(SEEN, lambda text: text.replace("/home/a/studio/takes/", ""))
    assert reply.model_dump(mode="json") == {
        "picture": "/9j/",
        "width": 640,
        "height": 480,
        "problems": [{"level": "warning", "text": "The file x.log has ended.", "fix": "Choose another."}],
        "performers": [{"user": 3, "text": "user 3: well", "joints": [[0.25, 0.5], None]}],
    }


def test_a_source_without_pictures_has_none():
    reply = look_reply(SEEN | {"picture": None}, str)
    assert (reply.picture, reply.width, reply.height) == ("", 0, 0)

"""What `fuse` says of many clips."""

from imgtransfer.pipeline.fuse_summary import FusedClip, notes_of, summary


def report(edge_m=0.004, normals=0.2, unseen=1.0, inside=0.0):
    return {
        "terms": {
            "edge": {"start": {"edge_length_m2": edge_m**2}, "end": {"edge_length_m2": 1.0}},
            "normal": {"start": {"normal_rendering": normals}, "end": {"normal_rendering": 2.0}},
        },
        "unseen_percent": unseen,
        "penetration_percent": {"before_clearance": 9.0, "after": inside},
    }


def test_a_usual_fusion_has_no_notes():
    assert notes_of(report()) == ()
    assert notes_of({"terms": {}, "unseen_percent": 0.0}) == ()


def test_whatever_looks_wrong_is_a_note_each():
    assert notes_of(report(edge_m=0.048)) == ("the maps are torn: edges are 48 mm off in them",)
    assert notes_of(report(normals=0.71)) == ("the normals do not belong to the positions: 0.71 apart",)
    assert notes_of(report(unseen=30)) == ("30 % of the vertices are in no view",)
    assert notes_of(report(inside=0.25)) == ("0.25 % of the vertices are still in the body",)
    assert len(notes_of(report(0.03, 1.0, 40, 1))) == 4


def test_a_line_a_clip():
    assert FusedClip("out/walk", 60, 3.25, ("odd",)).line() == "out/walk  60 frames, 3.2 s; odd"
    assert FusedClip("out/walk").line() == "out/walk  fused already"


def test_the_summary_counts_and_names_what_to_look_at():
    clips = [FusedClip("a", 60, 3.0), FusedClip("b", 40, 2.0, ("torn", "unseen")), FusedClip("c")]
    assert summary(clips).splitlines() == [
        "fused    2 clips, 100 frames, 0.050 s a frame",
        "left     1 of 3 clips, fused with these settings already; overwrite=True does it again",
        'look at  1 clip, see "When it goes wrong" in docs/fusion.md:',
        "  b: torn; unseen",
    ]
    assert summary([FusedClip("a", 1, 0.5)]) == "fused    1 clip, 1 frames, 0.500 s a frame"
    assert summary([]) == ""

use super::{Files, material, rgb};
use glam::DVec3;
use hatbox::scene::Physics;

const SQUARE: &str = "F 3\nV 1 0 0 0\nV 2 1 0 0\nV 3 1 1 0\nV 4 0 1 0\n";

#[test]
fn surfaces_become_faces_with_names_and_reflectances() {
    let text = format!(
        "t a title\n! # x y z\nc eps=1.e-5, encl = 1 ! closed\n/ nothing\n{SQUARE}v 5 .5 .5 1 ! the top\n\
         s 1 1 2 3 4 0 0 0.25 floor\nS 2 1 2 5 0 0 0 1 roof ! a triangle\nS 3 2 3 5 0 0 2 0.9 roof\n* end\nV x\n"
    );
    let files = Files::new(&[("room.vs3", text.as_bytes())]);
    let scene = files.read("room.vs3").expect("right");
    assert_eq!((scene.physics, scene.mesh.cells.len()), (Physics::Heat, 3));
    assert_eq!(scene.mesh.groups, ["floor", "roof"]);
    assert!((rgb(&material(&scene, "floor").reflectance, 0.0, 0.0)[0] - 0.75).abs() < 1e-15);
    assert!((rgb(&material(&scene, "roof#3").reflectance, 0.0, 0.0)[0] - 0.1).abs() < 1e-15);
    assert_eq!(scene.mesh.patch(0).normal(), DVec3::Z);
    assert_eq!(scene.mesh.cells[2].group, 1);
    assert_eq!(scene.warnings.len(), 2, "{:?}", scene.warnings);
    assert!(scene.warnings[0].contains("line 3: ") && scene.warnings[0].contains("eps = 0.00001, encl = 1"));
    assert!(scene.warnings[1].contains("`roof`") && scene.warnings[1].contains("`roof#3`"));
}

#[test]
fn what_is_wrong_is_said_with_its_line() {
    let one = "S 1 1 2 3 4 0 0 0.5 floor\n";
    let cases = [
        ("V 5 0 0\n", "line 6", "z is missing"),
        ("V 5 0 0 high\n", "line 6", "z is `high`"),
        ("V 5 0 0 nan\n", "line 6", "not finite"),
        ("V 4 0 0 1\n", "line 6", "vertex 4 is there already"),
        ("S 1 1 2 3 9 0 0 0.5 a\n", "line 6", "names vertex 9"),
        ("S 1 1 2 0 4 0 0 0.5 a\n", "line 6", "names vertex 0"),
        ("S 1 1 2 3 4 0 0 1.5 a\n", "line 6", "an emittance of 1.5"),
        ("S 1 1 2 3 4 0 0\n", "line 6", "the emittance is missing"),
        ("S 1 1 2 3 4 0 2 0.5 a\nS 2 1 2 3 4 0 0 0.5 b\n", "line 6", "the combine number of surface 1 is 2"),
        (&format!("{one}S 1 1 2 3 0 0 0 0.5 a\n"), "line 7", "surface 1 is there already"),
        (&format!("{one}S 2 1 2 3 0 0 1 0.5 a\nS 3 1 2 3 0 0 2 0.5 a\n"), "line 8", "cannot be combined"),
        (&format!("V 5 0 0 1\n{one}S 2 1 2 5 0 1 0 0.5 a\n"), "line 8", "in the plane of its base 1"),
        (&format!("V 5 2 0 0\n{one}S 2 1 5 3 0 1 0 0.5 a\n"), "line 8", "reaches beyond its base 1"),
        (&format!("{one}S 2 3 2 1 0 1 0 0.5 a\n"), "line 7", "must face the same way as its base 1"),
        (&format!("{one}N 2 1 2 3 0 1 0 0.5 a\n"), "line 7", "must face against its base 1"),
        (&format!("{one}N 2 3 2 1 0 0 0 0.5 a\n"), "line 7", "has no base"),
        (&format!("{one}M 2 3 2 1 0 1 0 0.5 a\n"), "line 7", "masking surfaces"),
        ("F 3a\n", "line 6", "`F 3a`"),
        ("C eps\n", "line 6", "`eps` has no number"),
        ("C accuracy=1\n", "line 6", "no control `accuracy`"),
        ("", "scene is empty", "no faces"),
    ];
    for (lines, place, reason) in cases {
        let files = Files::new(&[("bad.vs3", format!("{SQUARE}{lines}").as_bytes())]);
        let error = files.read("bad.vs3").expect_err(reason).to_string();
        assert!(error.contains(place) && error.contains(reason), "{lines}: {error}");
    }
    let only = "O 1 1 2 3 4\n";
    let files = Files::new(&[("bad.vs3", format!("{SQUARE}{only}").as_bytes())]);
    let error = hatbox::io::read_scene(&files.path("bad.vs3")).expect_err("nothing to compute").to_string();
    assert!(error.contains("only block light"), "{error}");
}

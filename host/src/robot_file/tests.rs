use super::*;
use gantry_tau_core::kinematics::Nominal;

fn refused(from: &str, to: &str) -> RobotFileError {
    assert!(L2.contains(from), "{from} is not in the file");
    let error = RobotFile::parse("x.toml", &L2.replacen(from, to, 1)).unwrap_err();
    assert_eq!(error.to_string().lines().count(), 1, "{error}");
    assert_eq!(error.file, "x.toml");
    error
}

#[test]
fn the_built_in_machine_is_the_vectors_machine() {
    let file = RobotFile::builtin_l2().unwrap();
    let text = include_str!("../../../tests/data/tau_vectors.json");
    let vectors: serde_json::Value = serde_json::from_str(text).unwrap();
    let numbers = |key: &str| {
        let value = vectors["l2"].get(key).unwrap_or(&vectors[key]).clone();
        serde_json::from_value::<Vec<[f64; 3]>>(value).unwrap()
    };
    let geometry = file.robot.geometry();
    for (key, ours) in [
        ("A0", geometry.cart_joints_m.as_slice()),
        ("V", &geometry.guideways),
        ("b", &geometry.platform_joints_m),
    ] {
        let theirs: Vec<_> = numbers(key).into_iter().map(Vector3::from).collect();
        assert_eq!(theirs, ours, "{key}");
    }
    let compliances = file.compliances.unwrap();
    let links: [f64; LINKS] = serde_json::from_value(vectors["c_link"].clone()).unwrap();
    assert!(
        compliances
            .link_m_per_n()
            .iter()
            .zip(&links)
            .all(|(a, b)| a.to_bits() == b.to_bits())
    );
    assert_eq!(file.limits[0].position.ramp, 100);
    let q = (Nominal::new(&file.robot, &Matrix3::identity()).unwrap())
        .inverse(&file.home_m())
        .unwrap();
    for (q, said) in q.iter().zip([0.6245, -0.6964, 0.6690]) {
        assert!((q - said).abs() < 6e-5, "{q}");
    }
}

#[test]
fn the_checksum_sees_the_kinematics_and_nothing_else() {
    let checksum = |text: &str| RobotFile::parse("x", text).unwrap().kinematics_checksum();
    let ours = checksum(L2);
    assert_eq!(ours, checksum(&L2.replace("gain = 1.0", "gain = 0.5")));
    assert_eq!(
        ours,
        checksum(&L2.replace("0.0, 0.0],\n    [1.0", "-0.0, 0.0],\n    [1.0"))
    );
    assert_ne!(
        ours,
        checksum(&L2.replace("L = [1.0, 1.1", "L = [1.0, 1.1000000000000003"))
    );
    assert_ne!(
        ours,
        checksum(&L2.replace("L = [1.0, 1.1", "L = [1.0, 1.2"))
    );
}

#[test]
fn every_error_names_its_key() {
    for (from, to, key) in [
        ("model = \"l2\"", "model = \"f1\"", "model"),
        ("model = \"l2\"", "", "model"),
        ("cf = -1", "cf = 0", "cf"),
        ("c = [1, -1, 1]", "c = [1, -1, 2]", "c[2]"),
        ("L = [1.0, 1.1", "L = [1.0, nan", "L[1]"),
        ("L = [1.0, 1.1", "L = [1.0, -1.1", "L[1]"),
        ("c_link = [5.0e-7", "c_link = [-5.0e-7", "c_link[0]"),
        ("c_cart = [", "# c_cart = [", "c_cart"),
        ("[ 0.00,  0.08, 0.05]", "[ 0.00,  0.08, 0.06]", "A0"),
        ("gain = 1.0", "gain = 1.1", "client.gain"),
        ("gain = 1.0", "gain = nan", "client.gain"),
        ("gain = 1.0", "gian = 1.0", "client.gian"),
        ("gain = 1.0", "", "client.gain"),
        ("gain = 1.0", "gain = \"one\"", "client.gain"),
        ("gain = 1.0", "gain = ", "client.gain"),
        ("seed = 2013", "seed = -1", "simulation.seed"),
        (
            "home_m = [0.0, 0.5, 0.65]",
            "home_m = [0.0, 9.5, 0.65]",
            "simulation.home_m",
        ),
        (
            "home_m = [0.0, 0.5, 0.65]",
            "home_m = [0.0, 0.5]",
            "simulation.home_m",
        ),
        (
            "metres_per_q = [1.0",
            "metres_per_q = [2.0",
            "axes.metres_per_q[0]",
        ),
        (
            "ramp_um = [0.1",
            "ramp_um = [0.1005",
            "axes.position.ramp_um[0]",
        ),
        (
            "ramp_um = [0.1",
            "ramp_um = [0.0",
            "axes.position.ramp_um[0]",
        ),
        (
            "accel_um = [10.0",
            "accel_um = [5.05",
            "axes.position.accel_um[0]",
        ),
        (
            "max_um = [2000.0",
            "max_um = [1e300",
            "axes.position.max_um[0]",
        ),
        (
            "max_um = [2000.0",
            "max_um = [10001",
            "axes.nominal_travel_m[0]",
        ),
        (
            "[[-0.51, 2.01]",
            "[[2.01, -0.51]",
            "axes.machine_travel_m[0]",
        ),
        (
            "max_permille = [50",
            "max_permille = [-1",
            "axes.torque.max_permille[0]",
        ),
        (
            "max_permille = [50",
            "max_permille = [99999",
            "axes.torque.max_permille",
        ),
        (
            "axis_of_motor = [0, 1, 2]",
            "axis_of_motor = [0, 1, 1]",
            "motors.axis_of_motor",
        ),
        (
            "axis_of_motor = [0, 1, 2]",
            "axis_of_motor = [0, 1, 3]",
            "motors.axis_of_motor",
        ),
        ("[0.0, -1.0, 0.0]", "[0.0, 1.0, 0.0]", "sensor.rotation"),
        ("cutoff_hz = 20.0", "cutoff_hz = inf", "sensor.cutoff_hz"),
    ] {
        let error = refused(from, to);
        assert_eq!(error.key, key, "{error}");
    }
    let error = RobotFile::load("no/such/robot.toml").unwrap_err();
    assert!(
        error.to_string().starts_with("no/such/robot.toml: "),
        "{error}"
    );
}

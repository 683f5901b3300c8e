//! The thesis' evaluation of simulated series.

use gantry_tau_core::model::l2::AXES;
use gantry_tau_machine::elastic::springs::Springs;
use gantry_tau_machine::model::{L2, MachineKind};
use gantry_tau_machine::robot_file::RobotFile;
use nalgebra::{Matrix6, Point3};

use super::*;
use crate::experiment::fixture::{Folder, LEVELS, campaign_a, plan_in};
use crate::experiment::simulated::simulate;
use crate::experiment::table::WindowTable;
use crate::measurements::springs::{self, Campaign};

/// The simulated campaign A, with instruments that hardly err.
fn campaign(folder: &Folder, robot: &RobotFile<L2, AXES>) -> (Campaign<AXES>, Springs<AXES>) {
    let text = campaign_a("", &LEVELS)
        .replace("gauge_um = 1.0", "gauge_um = 0.001")
        .replace("force_n = 1.0", "force_n = 0.001");
    let plan = plan_in(folder, &text);
    let simulated = simulate(robot, robot, &plan).unwrap();
    let mut table = WindowTable::open(&folder.path("springs.csv"), &plan, false).unwrap();
    for row in &simulated.rows {
        table.write(&plan, row).unwrap();
    }
    (
        springs::read(&folder.path("plan.toml"), "l2", &robot.metres_per_q).unwrap(),
        simulated.truth,
    )
}

fn evaluated(robot: &RobotFile<L2, AXES>, campaign: &Campaign<AXES>) -> Vec<ThesisSprings> {
    let geometry = robot.model.geometry();
    let file = Springs::of(robot).unwrap();
    let problem = SpringsProblem::new(&geometry, &file, campaign);
    (0..campaign.series.len())
        .map(|series| evaluate(&problem, series).unwrap())
        .collect()
}

fn robot() -> RobotFile<L2, AXES> {
    let mut robot = RobotFile::builtin_l2().unwrap();
    robot.simulation.jump_gap_m = 0.0;
    robot
}

/// Carts are measured against their rails, so that a straight line finds them; links are not, as
/// the platform turns `[T 6.1]`.
#[test]
fn lines_find_carts_and_not_links() {
    let folder = Folder::new("thesis");
    let robot = robot();
    let (campaign, truth) = campaign(&folder, &robot);
    let all = evaluated(&robot, &campaign);
    assert_eq!(
        all.iter()
            .map(|thesis| thesis.series.clone())
            .collect::<Vec<_>>(),
        campaign.series
    );
    let truth = truth.vector();
    let mut negative = 0;
    let mut count = 0;
    for thesis in &all {
        for (axis, line) in thesis.axes.iter().enumerate() {
            // Loads of axes are those of the unloaded pose: the tool moves by 0.2 mm under the
            // load, and its lever by 2.5 mrad.
            let most = line
                .points
                .iter()
                .map(|(load, _)| load.abs())
                .fold(0.0, f64::max);
            let off = (line.compliance.unwrap() / truth[LINKS + axis] - 1.0).abs() * most / 300.0;
            assert!(off < 0.01, "{} {axis}: {off}", thesis.series);
        }
        for slope in thesis.links.iter().filter_map(|line| line.compliance) {
            negative += i32::from(slope < 0.0);
            count += 1;
        }
    }
    assert!(count > 40 && negative > 10, "{negative} of {count}");
}

/// A platform that moves and does not turn, in proportion to the force: the line of a link has the
/// slope that its direction says.
#[test]
fn a_link_is_longer_by_its_share_of_the_translation() {
    let folder = Folder::new("translated");
    let robot = robot();
    let (mut campaign, _) = campaign(&folder, &robot);
    let moved = Vector3::new(0.3, -0.2, 0.5) * 1e-6;
    for window in &mut campaign.windows {
        let force = window.load.fixed_rows::<3>(0).norm();
        for (gauge, named) in campaign.gauges.iter().enumerate() {
            let Gauge::Face { axis, .. } = named.gauge else {
                continue;
            };
            window.readings_m[gauge] = Some(axis.dot(&moved) * force);
        }
        window
            .readings_m
            .iter_mut()
            .skip(6)
            .for_each(|axis| *axis = Some(0.0));
    }
    let geometry = robot.model.geometry();
    let first = &campaign.windows[0];
    let tool = Point3::from(campaign.poses[0].1.position_m).coords;
    let arm = [0, 1, 1, 2, 2, 2];
    let joints = geometry.platform_joints_m;
    let directions: [Vector3<f64>; LINKS] = std::array::from_fn(|link| {
        let cart = geometry.carts_m[arm[link]] + geometry.guideways[arm[link]] * first.q[arm[link]];
        (cart + geometry.plate_joints_m[link] - tool - joints[link]).normalize()
    });
    // Forces of the links on the platform and the load are in balance: sum f (s, b x s) = w for
    // tensions -f... as of `W f = -w`.
    let wrenches = Matrix6::from_columns(&std::array::from_fn::<_, 6, _>(|link| {
        let s = directions[link];
        let m = joints[link].cross(&s);
        Vector6::new(s.x, s.y, s.z, m.x, m.y, m.z)
    }));
    let all = evaluated(&robot, &campaign);
    for (series, thesis) in all.iter().enumerate() {
        let of_series = campaign
            .windows
            .iter()
            .filter(|window| window.series == series);
        let largest = of_series
            .max_by(|one, other| one.load.norm().total_cmp(&other.load.norm()))
            .unwrap();
        let force = largest.load.fixed_rows::<3>(0).norm();
        let tensions = wrenches.lu().solve(&-largest.load).unwrap();
        for (link, line) in thesis.links.iter().enumerate() {
            // A link that hardly pulls has the noise of the load.
            if tensions[link].abs() < 30.0 {
                continue;
            }
            let expected = -directions[link].dot(&moved) * force / tensions[link];
            let off = (line.compliance.unwrap() / expected - 1.0).abs();
            assert!(off < 0.03, "{} {link}: {off}", thesis.series);
        }
    }
}

#[test]
fn the_page_shows_all_three() {
    let folder = Folder::new("thesis-page");
    let robot = robot();
    let (campaign, _) = campaign(&folder, &robot);
    let shown = page(
        &robot,
        &folder.path("plan.toml"),
        &folder.path("springs.csv"),
    )
    .unwrap();
    for series in &campaign.series {
        assert!(shown.contains(&format!("series {series}")), "{series}");
    }
    for printed in printed::links::<AXES>()
        .iter()
        .chain(printed::axes::<AXES>())
    {
        assert!(shown.contains(&format!("[T {}]", printed.table)));
        assert!(
            printed
                .values
                .iter()
                .all(|value| shown.contains(&format!("{value:.4}")))
        );
    }
    assert!(
        shown.contains("<th>identify</th><td><b>")
            && shown.contains("no spring has")
            && !shown.contains("NaN")
    );
    assert_eq!(shown.matches("<svg").count(), LINKS + AXES);
    // One window has no line, and nothing for identify.
    let text = std::fs::read_to_string(folder.path("springs.csv")).unwrap();
    let few: Vec<&str> = text.lines().take(2).collect();
    std::fs::write(folder.path("few.csv"), few.join("\n") + "\n").unwrap();
    let shown = page(&robot, &folder.path("plan.toml"), &folder.path("few.csv")).unwrap();
    assert!(shown.contains("identify finds nothing in this table: ") && !shown.contains("<svg"));
}

/// The campaign of the thesis: beside its slopes, what it does not show.
#[test]
fn the_page_says_what_a_campaign_as_the_thesis_does_not_show() {
    let folder = std::path::Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../../tests/data/identify/thesis-follow-b4");
    let robot = RobotFile::builtin_l2().unwrap();
    let page = page(
        &robot,
        &folder.join("campaign.toml"),
        &folder.join("springs.csv"),
    )
    .unwrap();
    let said = page.split_once("says of this campaign:").unwrap().1;
    assert!(
        said.matches("<li>").count() >= 3 && said.contains("not observable, kept at the file"),
        "{said}"
    );
}

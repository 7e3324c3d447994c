//! `phalanx run --ros2`: ROS 2 receives the poses of robots, and sends goals to robots that accept them.
//!
//! Requires the feature `bridge`; without it the flags exist, and report that it is missing.

use std::net::SocketAddr;

use clap::Args;
use experiment::scenario::Scenario;
use formation::front_point::front_point;
use protocol::law::Reference;
use protocol::ros2::{GoalBrief, Ros2Brief};

use super::screen::print_misuse;
use super::with_bridge::ros2_brief;

/// Default address of the rmw_zenoh router.
const ROUTER_ADDRESS: &str = "127.0.0.1:7447";
/// Prefix of an address at which this process is the router.
const LISTEN_PREFIX: &str = "listen/";
/// Maximum ROS domain ID.
const DOMAIN_MAX: u32 = 232;
/// Maximum publishing rate, Hz: the highest sample rate of a plant in real time.
const RATE_HZ_MAX: f64 = 1_000.0;

/// ROS 2 options of a run.
#[derive(Debug, Args)]
pub(super) struct Ros2Args {
    /// Publish the odometry of each robot and /tf to ROS 2, and accept goals from it, in real time: through
    /// the rmw_zenoh router at this address of this machine [default: 127.0.0.1:7447], or, with the prefix
    /// `listen/`, as that router.
    #[arg(
        long,
        value_name = "[listen/]ADDR",
        num_args = 0..=1,
        require_equals = true,
        default_missing_value = ROUTER_ADDRESS,
        value_parser = parse_endpoint
    )]
    ros2: Option<Endpoint>,
    /// ROS domain ID [default: ROS_DOMAIN_ID of the environment, or 0].
    #[arg(
        long,
        value_name = "ID",
        requires = "ros2",
        value_parser = clap::value_parser!(u32).range(..=i64::from(DOMAIN_MAX))
    )]
    ros2_domain: Option<u32>,
    /// Messages per second and robot.
    #[arg(long, value_name = "HZ", requires = "ros2", default_value = "50", value_parser = parse_hz)]
    ros2_hz: f64,
}

/// Endpoint of the connection to ROS 2.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Endpoint {
    address: SocketAddr,
    listens: bool,
}

fn parse_endpoint(text: &str) -> Result<Endpoint, String> {
    let (listens, text) = match text.strip_prefix(LISTEN_PREFIX) {
        Some(rest) => (true, rest),
        None => (false, text),
    };
    let address: SocketAddr = text.parse().map_err(|_| {
        format!(
            "must be ADDRESS:PORT or {LISTEN_PREFIX}ADDRESS:PORT, such as {ROUTER_ADDRESS} or {LISTEN_PREFIX}{ROUTER_ADDRESS}"
        )
    })?;
    // The connection has neither encryption nor access control.
    if !address.ip().is_loopback() {
        return Err(
            "must be an address of this machine alone (loopback), such as 127.0.0.1: the router of \
                    rmw_zenoh on it forwards the messages to other machines"
                .into(),
        );
    }
    Ok(Endpoint { address, listens })
}

fn parse_hz(text: &str) -> Result<f64, String> {
    let hz = text.parse().ok().filter(|&hz: &f64| hz > 0.0 && hz <= RATE_HZ_MAX);
    hz.ok_or_else(|| format!("must be above 0 and at most {RATE_HZ_MAX}"))
}

impl Ros2Args {
    /// Returns the configuration of the ROS 2 bridge without its run root; `None` without --ros2. On an
    /// error, prints it and returns the exit code. `is_local` returns by index whether a robot runs on this
    /// host.
    pub(super) fn to_bridge_brief(
        &self,
        scenario: &Scenario,
        is_realtime: bool,
        is_local: impl Fn(usize) -> bool,
    ) -> Result<Option<Ros2Brief>, u8> {
        let Some(Endpoint { address, listens }) = self.ros2 else { return Ok(None) };
        if !is_realtime {
            let message = "--ros2 requires --pace realtime: lockstep time is not ROS time";
            return Err(print_misuse(&message));
        }
        let domain = match (self.ros2_domain, std::env::var("ROS_DOMAIN_ID")) {
            (Some(domain), _) => domain,
            (None, Err(_)) => 0,
            (None, Ok(text)) => match text.parse().ok().filter(|&domain| domain <= DOMAIN_MAX) {
                Some(domain) => domain,
                None => {
                    return Err(print_misuse(&format_args!(
                        "ROS_DOMAIN_ID is {text:?}, but must be a number from 0 to {DOMAIN_MAX}"
                    )));
                }
            },
        };
        let brief = ros2_brief(scenario, address, listens, domain, self.ros2_hz)?;
        let robots = scenario.robots.iter().enumerate();
        let goal_robots =
            robots.filter(|&(i, robot)| robot.role.reference == Reference::Goal && is_local(i));
        let goals = goal_robots.map(|(_, robot)| GoalBrief {
            robot: robot.name.clone(),
            start_m: front_point(robot.start, robot.front_point_m).into(),
        });
        Ok(Some(Ros2Brief { goals: goals.collect(), ..brief }))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endpoint_accepts_loopback_addresses_only() {
        let router = parse_endpoint(ROUTER_ADDRESS).unwrap();
        assert_eq!((router.address.port(), router.listens), (7447, false));
        assert!(parse_endpoint("listen/[::1]:7448").unwrap().listens);
        assert!(parse_endpoint("listen/0.0.0.0:7447").unwrap_err().contains("this machine alone"));
        assert!(parse_endpoint("192.168.1.2:7447").unwrap_err().contains("this machine alone"));
        assert!(parse_endpoint("7447").unwrap_err().contains("ADDRESS:PORT"));
    }

    #[test]
    fn rate_out_of_range_is_rejected() {
        assert_eq!(parse_hz("12.5"), Ok(12.5));
        for text in ["0", "-1", "1001", "NaN", "fast"] {
            assert!(parse_hz(text).is_err(), "{text}");
        }
    }
}

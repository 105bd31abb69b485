use pid_runtime::robot;

robot! {
    pub robot Arm {
        gravity: [0, 0, -9.81] m/s^2;
        link rod { mass: 1 kg; com: [0, 0, 0.2] m; }
        joint pivot: revolute about y { base -> rod; }
        potential += 1 J*sqrt(-1 - q.pivot^2);
    }
}

fn main() {}

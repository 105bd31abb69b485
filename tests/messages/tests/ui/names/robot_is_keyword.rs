use pid_runtime::robot;

robot! {
    pub robot struct {
        gravity: [0, 0, -9.81] m/s^2;
    }
}

fn main() {}

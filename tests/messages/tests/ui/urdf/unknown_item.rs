use pid_runtime::robot;

robot! {
    pub robot Arm from urdf "nowhere.urdf" {
        inertia: free;
        friction: open;
        emit { dynamic }
        limit ops;
    }
}

fn main() {}
